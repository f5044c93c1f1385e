#include "server/store/reader_pool.h"

#include "protocol/base/clock.h"
#include "server/store/connection.h"
#include "server/store/damage.h"

namespace myograde::server {
namespace {

// Idle connections kept open between requests; each has a cache of about 1 MiB (OpenForReading).
constexpr size_t kKept = 8;

}  // namespace

ReaderPool::ReaderPool(std::string path) : path_(std::move(path)) {}
ReaderPool::~ReaderPool() = default;

absl::StatusOr<std::unique_ptr<SQLite::Database>> ReaderPool::Take() {
  {
    const MutexLock lock(mutex_);
    if (!free_.empty()) {
      std::unique_ptr<SQLite::Database> db = std::move(free_.back());
      free_.pop_back();
      return db;
    }
  }
  return OpenForReading(path_);
}

absl::Status ReaderPool::Read(const std::function<absl::Status(const Transaction&)>& body) {
  absl::StatusOr<std::unique_ptr<SQLite::Database>> db = Take();
  if (IsCorruptStore(db.status()) && corrupt_observer_ != nullptr) corrupt_observer_(db.status());
  if (!db.ok()) return db.status();
  const absl::Duration begin = SystemClock().Monotonic();
  absl::Status answer;
  const absl::Status status = GuardSqlite(path_, [&] {
    SQLite::Transaction transaction(**db);  // deferred: all queries see one state
    const Transaction reader({.db = **db, .fold = &fold_});
    answer = body(reader);
    transaction.commit();
    return absl::OkStatus();
  });
  if (observer_ != nullptr) observer_(SystemClock().Monotonic() - begin);
  if (IsCorruptStore(status) && corrupt_observer_ != nullptr) corrupt_observer_(status);
  if (!status.ok()) return status;  // close the connection, as its state is unknown
  const MutexLock lock(mutex_);
  if (free_.size() < kKept) free_.push_back(*std::move(db));
  return answer;
}

absl::Status ReaderPool::Backup(const std::string& path,
                                const std::function<void(int64_t, int64_t)>& progress,
                                const std::function<void(const std::string&)>& damaged) {
  ASSIGN_OR_RETURN(std::unique_ptr<SQLite::Database> source, OpenForReading(path_));
  return GuardSqlite(path, [&] { return CopyDatabase(*source, path_, path, progress, damaged); });
}

}  // namespace myograde::server
