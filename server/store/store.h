// The daemon's persistent state: its only writer, and its readers. A change runs operations inside
// one transaction, so it is applied as a whole or not at all:
//
//   absl::Status status = store->Write([&](Transaction& store) -> absl::Status {
//     RETURN_IF_ERROR(store.blocks.Finish(block, attempt, output, "daemon"));
//     return store.evaluations.End(evaluation, EvaluationState::kDone, "", hash, "daemon");
//   });
//
// A failed change leaves nothing in the store and may be tried again later: an operation whose
// effect is already there succeeds.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "protocol/base/mutex.h"
#include "protocol/base/status_macros.h"
#include "server/store/transaction.h"

namespace myograde::server {

// The number of this program's schema.
int SchemaVersion();

class Store {
 public:
  // Opens or creates the store at `path`; errors as in connection.h. `clock` must outlive it. Not
  // thread-safe.
  static absl::StatusOr<std::unique_ptr<Store>> Open(const std::string& path, const Clock& clock);
  ~Store();

  // Runs `change` in one transaction; commits if it returns OkStatus(). Errors of Check().
  absl::Status Write(const std::function<absl::Status(Transaction&)>& change);

  // Whether what is written now would still be there tomorrow. UnavailableError: the store's file, or
  // its write-ahead log, was removed, replaced, cut off or overwritten with an older one since it was
  // opened, or somebody found it corrupt. Safe from any thread.
  absl::Status Check();
  // From now on Check() fails for this reason: the store is corrupt.
  void Distrust(const std::string& why);

  // A time before this start that is surely over: what Transaction::SetTrustedTime wrote last, else
  // that of the newest row; nullopt: there was neither.
  std::optional<int64_t> trusted_time_ms() const { return trusted_time_ms_; }

  // Who is told of what is written from now on. Not while anybody writes.
  void SetWebhooks(std::vector<WebhookConfig> webhooks) { webhooks_ = std::move(webhooks); }

 private:
  Store(std::string path, std::unique_ptr<SQLite::Database> db, const Clock& clock);

  struct File {
    uint64_t device = 0;
    uint64_t inode = 0;  // 0: it is not there
    int64_t modified_ns = 0;
    int64_t bytes = 0;
  };
  // The database and its log. Only a checkpoint changes the one or cuts the other, and so tells when
  // to read what is in them.
  using Files = std::array<File, 2>;
  static Files FilesOf(const std::string& path);
  // Distrusts the store if what was written last is not in its files any more.
  void Watch(const Files& files);
  void Remember(int64_t rows);

  std::string path_;
  Files opened_;  // as they were then
  mutable Mutex mutex_;
  std::string distrust_ ABSL_GUARDED_BY(mutex_);  // "": none
  Files seen_ ABSL_GUARDED_BY(mutex_);
  int64_t rows_ ABSL_GUARDED_BY(mutex_) = 0;  // RowsEver as of the last write
  std::unique_ptr<SQLite::Database> db_;
  BoardState board_;  // of the journal; empty again after what was rolled back
  const Clock& clock_;
  std::optional<int64_t> trusted_time_ms_;
  std::vector<WebhookConfig> webhooks_;
};

// Connections that read the store while the daemon writes it, each in one consistent state. Safe to
// use from any thread.
class ReaderPool {
 public:
  explicit ReaderPool(std::string path);
  ~ReaderPool();

  // Is told how long each Read took, and whether the store could be read, on any thread. Before
  // anybody reads.
  void SetObserver(std::function<void(absl::Duration, const absl::Status&)> observer) {
    observer_ = std::move(observer);
  }

  // Runs `body` on a free connection, or opens one.
  absl::Status Read(const std::function<absl::Status(const Transaction&)>& body);
  // The same for a body that gives a value.
  template <typename T>
  absl::StatusOr<T> Read(const std::function<absl::StatusOr<T>(const Transaction&)>& body) {
    absl::StatusOr<T> value = absl::UnknownError("");
    RETURN_IF_ERROR(Read([&](const Transaction& reader) {
      value = body(reader);
      return value.status();
    }));
    return value;
  }
  // Writes a copy of the current store to a new file at `path` while others go on writing; calls
  // `progress` with page counts from time to time. The copy is checked as a file; damaged rows in
  // it are passed to `damaged`.
  absl::Status Backup(const std::string& path,
                      const std::function<void(int64_t done, int64_t total)>& progress,
                      const std::function<void(const std::string& what)>& damaged);

 private:
  absl::StatusOr<std::unique_ptr<SQLite::Database>> Take();

  const std::string path_;
  BoardFold fold_;
  std::function<void(absl::Duration, const absl::Status&)> observer_;
  Mutex mutex_;
  std::vector<std::unique_ptr<SQLite::Database>> free_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace myograde::server
