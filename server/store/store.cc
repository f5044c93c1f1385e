#include "server/store/store.h"

#include <sys/stat.h>

#include <absl/cleanup/cleanup.h>
#include <absl/strings/str_cat.h>

#include "server/store/connection.h"

namespace myograde::server {
namespace {

// Of those that an evaluation or a person leaves.
std::optional<int64_t> NewestRow(SQLite::Database& db) {
  Statement select(db, R"(SELECT max(at) FROM (SELECT max(accepted_at) AS at
      FROM submission UNION ALL SELECT max(finished_at) FROM evaluation UNION ALL SELECT max(at)
      FROM upload UNION ALL SELECT at FROM (SELECT at FROM transition ORDER BY id DESC
      LIMIT 1) UNION ALL SELECT at FROM (SELECT at FROM access_event ORDER BY id DESC LIMIT 1)))");
  if (!select.executeStep() || !select.getColumn(0).isInteger()) return std::nullopt;
  return select.getColumn(0).getInt64();
}

// What SetTrustedTime wrote, else the time of the newest row. A row that was written while the clock was
// wrong says nothing about it.
std::optional<int64_t> TrustedTimeOf(SQLite::Database& db) {
  const int64_t ms = MetaNumber(db, "trusted_time");
  return ms > 0 ? ms : NewestRow(db);
}

// How many rows were ever added to the tables that number their rows so. It never goes back.
int64_t RowsEver(SQLite::Database& db) {
  return db.execAndGet("SELECT CAST(total(seq) AS INTEGER) FROM sqlite_sequence").getInt64();
}

constexpr size_t kDatabase = 0;
constexpr size_t kLog = 1;
constexpr const char* kEndings[] = {"", "-wal"};

// Idle connections kept open between requests; each has a cache of about 1 MiB (OpenForReading).
constexpr size_t kKept = 8;

}  // namespace

int SchemaVersion() { return static_cast<int>(SchemaMigrations().size()); }

Store::Store(std::string path, std::unique_ptr<SQLite::Database> db, const Clock& clock)
    : path_(std::move(path)), db_(std::move(db)), clock_(clock) {}

Store::~Store() = default;

absl::StatusOr<std::unique_ptr<Store>> Store::Open(const std::string& path, const Clock& clock) {
  ASSIGN_OR_RETURN(std::unique_ptr<SQLite::Database> opened, OpenForWriting(path));
  std::unique_ptr<Store> store(new Store(path, std::move(opened), clock));
  RETURN_IF_ERROR(GuardSqlite(path, [&]() -> absl::Status {
    SQLite::Database& db = *store->db_;
    store->trusted_time_ms_ = TrustedTimeOf(db);
    SQLite::Transaction transaction(db, SQLite::TransactionBehavior::IMMEDIATE);
    FillTeamSkeletons(db);
    transaction.commit();
    store->Remember(RowsEver(db));
    return absl::OkStatus();
  }));
  store->opened_ = FilesOf(path);
  return store;
}

Store::Files Store::FilesOf(const std::string& path) {
  Files files;
  for (const size_t i : {kDatabase, kLog}) {
    struct stat info;
    if (stat((path + kEndings[i]).c_str(), &info) != 0) continue;
    files[i] = {info.st_dev, info.st_ino,
                info.st_mtim.tv_sec * int64_t{1'000'000'000} + info.st_mtim.tv_nsec, info.st_size};
  }
  return files;
}

void Store::Remember(int64_t rows) {
  const MutexLock lock(mutex_);
  rows_ = rows;
  seen_[kLog].bytes = FilesOf(path_)[kLog].bytes;
}

void Store::Watch(const Files& files) {
  int64_t written = 0;
  {
    const MutexLock lock(mutex_);
    if (files[kDatabase].modified_ns == seen_[kDatabase].modified_ns &&
        files[kLog].bytes >= seen_[kLog].bytes) {
      return;
    }
    written = rows_;
  }
  int64_t there = 0;
  // A new connection has no pages in memory.
  absl::StatusOr<std::unique_ptr<SQLite::Database>> db = OpenForReading(path_);
  const absl::Status read = !db.ok() ? db.status() : GuardSqlite(path_, [&] {
    there = RowsEver(**db);
    return absl::OkStatus();
  });
  if (MayPass(read)) return;  // the next look reads again
  if (!read.ok()) return Distrust(std::string(read.message()));
  if (there < written) {
    return Distrust(absl::StrCat(
        path_, ": was overwritten with an older store while the daemon runs; restore the newest backup"));
  }
  const MutexLock lock(mutex_);
  seen_ = files;
}

absl::Status Store::Check() {
  const Files files = FilesOf(path_);
  for (const size_t i : {kDatabase, kLog}) {
    const File& file = opened_[i];
    if (file.inode == 0) continue;
    if (files[i].device == file.device && files[i].inode == file.inode) continue;
    return absl::UnavailableError(absl::StrCat(
        path_, kEndings[i], ": was ", files[i].inode != 0 ? "replaced" : "removed",
        " while the daemon runs, so nothing that it writes would last; stop the daemon, restore the "
        "store from a backup, and start it again"));
  }
  Watch(files);
  const MutexLock lock(mutex_);
  if (distrust_.empty()) return absl::OkStatus();
  return absl::UnavailableError(
      absl::StrCat(distrust_, "; nothing is accepted until the daemon is started again"));
}

void Store::Distrust(const std::string& why) {
  const MutexLock lock(mutex_);
  if (distrust_.empty()) distrust_ = why;
}

absl::Status Store::Write(const std::function<absl::Status(Transaction&)>& change) {
  RETURN_IF_ERROR(Check());
  const absl::Cleanup check = [&] {
    const absl::Status read = GuardSqlite(path_, [&] {
      ForgetRolledBack(*db_, board_);
      return absl::OkStatus();
    });
    if (!read.ok()) board_ = BoardState();
  };
  return GuardSqlite(path_, [&]() -> absl::Status {
    SQLite::Transaction transaction(*db_, SQLite::TransactionBehavior::IMMEDIATE);
    Transaction changes({.db = *db_,
                         .state = &board_,
                         .now_ms = absl::ToUnixMillis(clock_.Now()),
                         .webhooks = &webhooks_});
    RETURN_IF_ERROR(change(changes));  // rolls back
    const int64_t rows = RowsEver(*db_);
    transaction.commit();
    Remember(rows);
    return absl::OkStatus();
  });
}

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
  const absl::Duration begin = SystemClock().Monotonic();
  absl::StatusOr<std::unique_ptr<SQLite::Database>> db = Take();
  absl::Status answer;
  const absl::Status status = !db.ok() ? db.status() : GuardSqlite(path_, [&] {
    SQLite::Transaction transaction(**db);  // deferred: all queries see one state
    const Transaction reader({.db = **db, .fold = &fold_});
    answer = body(reader);
    transaction.commit();
    return absl::OkStatus();
  });
  if (observer_ != nullptr) observer_(SystemClock().Monotonic() - begin, status);
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
