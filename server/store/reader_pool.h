// Reads the store while the daemon writes it, on separate connections that each see one consistent
// state.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/mutex.h"
#include "protocol/base/status_macros.h"
#include "server/store/transaction.h"

namespace myograde::server {

// Connections for readers; safe to use from any thread.
class ReaderPool {
 public:
  explicit ReaderPool(std::string path);
  ~ReaderPool();

  // Is told how long each Read took. Before anybody reads.
  void SetObserver(std::function<void(absl::Duration)> observer) {
    observer_ = std::move(observer);
  }

  // Is told of each Read that found the store corrupt (damage.h), on any thread. Before anybody
  // reads.
  void SetCorruptObserver(std::function<void(const absl::Status&)> observer) {
    corrupt_observer_ = std::move(observer);
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
  std::function<void(absl::Duration)> observer_;
  std::function<void(const absl::Status&)> corrupt_observer_;
  Mutex mutex_;
  std::vector<std::unique_ptr<SQLite::Database>> free_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace myograde::server
