// The statistics of boards that were computed already.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include <absl/status/statusor.h>

#include "protocol/base/mutex.h"
#include "scoring/groups.h"
#include "server/api/board_query.h"
#include "server/api/board_statistics.h"

namespace myograde::server {

// Safe from any thread. Everybody may ask for any moment of a board, and the tests of one take seconds:
// they are made once for all moments between two changes of the board, one board at a time, and only as
// long as the request waits.
class KeptStatistics {
 public:
  // Those of `board`, which is the one that `asked` asks for. UnavailableError with the code "busy": too
  // many requests wait already. DeadlineExceededError: the request's time is over.
  absl::StatusOr<std::shared_ptr<const BoardStatistics>> Of(Reader& reader, const BoardQuery& asked,
                                                            const Leaderboard& board,
                                                            const scoring::GroupRules& rules);

 private:
  // What they depend on.
  struct Key {
    std::string config;
    std::string board;
    int64_t freeze_ms = 0;
    int64_t changed_ms = 0;  // the board's last change up to the moment
    int64_t changes = 0;     // the store's count of changes

    bool operator==(const Key&) const = default;
  };
  using Made = std::shared_ptr<const BoardStatistics>;

  Made Find(const Key& key);

  std::timed_mutex computing_;
  std::atomic<int> waiting_ = 0;
  Mutex mutex_;
  std::deque<std::pair<Key, Made>> made_ ABSL_GUARDED_BY(mutex_);  // the newest first
};

}  // namespace myograde::server
