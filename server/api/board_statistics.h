// Which places of a board its episodes decide (scoring/groups.h), from the store, and the further
// episodes of its submissions: rejudges of the purpose "seeds", which are part of its statistics
// and of no rank.
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/base/mutex.h"
#include "scoring/groups.h"
#include "scoring/statistics_config.h"
#include "server/access/rate_limit.h"
#include "server/api/board_source.h"
#include "server/api/context.h"
#include "server/grading/leaderboard.h"
#include "server/grading/tracks.h"
#include "server/store/store.h"

namespace myograde::server {

// How the board of a phase ("": of none) tells close places apart.
scoring::StatisticsConfig FindStatisticsConfig(const ApiContext& context, const std::string& phase);

// An evaluation of further episodes that is played, or will be.
struct FurtherItem {
  int64_t evaluation = 0;                            // 0: it is still to be added
  EvaluationState state = EvaluationState::kQueued;  // neither cancelled nor grader_error
  std::vector<uint64_t> seeds;                       // by index of its episodes
  bool dropped = false;                              // counts no more, but somebody may have looked
};
// By submission, oldest rejudge first.
using FurtherItems = std::map<int64_t, std::vector<FurtherItem>>;

// Of the submissions on the board of a config, without those of rejudges that can't be read.
absl::StatusOr<FurtherItems> ListFurtherItems(const Transaction& reader, const std::string& config);

// What is known of one of the first places.
struct TestedPlace {
  size_t row = 0;       // in Leaderboard::rows
  int64_t further = 0;  // further episodes that are part of its tests
  scoring::PlaceInGroup place;
  // The intervals of the board's criteria that are means over steps; nullopt for the others.
  std::vector<std::optional<scoring::Spread>> over_steps;
};

struct BoardStatistics {
  std::vector<TestedPlace> places;  // the first of the board that can be read, in its order
  int64_t tests = 0;
  std::vector<Damage> damaged;
};

// `rules`: of the board, which MakeLeaderboard made. `before_ms`: what ended from then on is left
// out. Reads the episodes of the first places only. DeadlineExceededError: the request was over
// (HttpServer::IsOver) before all tests were made.
absl::StatusOr<BoardStatistics> ComputeStatistics(const Transaction& reader, const Track& track,
                                                  const scoring::BoardRules& rules,
                                                  const Leaderboard& board,
                                                  const scoring::GroupRules& group_rules,
                                                  int64_t before_ms);

// Where ranks are those of groups: the published rank of each row of the board, 0 for a baseline.
std::vector<int64_t> PublishedRanks(const Leaderboard& board, const BoardStatistics& statistics);

// The statistics of boards that were computed already. Safe from any thread. Everybody may ask for
// any moment of a board, and the tests of one take seconds: they are made once for all moments
// between two changes of the board, one board at a time, and only as long as the request waits.
class KeptStatistics {
 public:
  // Those of `board`, which is the one that `asked` asks for. UnavailableError with the code
  // "busy": too many requests wait already. DeadlineExceededError: the request's time is over.
  absl::StatusOr<std::shared_ptr<const BoardStatistics>> Of(const Transaction& reader,
                                                            const BoardQuery& asked,
                                                            const Leaderboard& board,
                                                            const scoring::GroupRules& rules);

 private:
  using Made = std::shared_ptr<const BoardStatistics>;

  Made Find(const std::string& key);

  std::timed_mutex computing_;
  std::atomic<int> waiting_ = 0;
  Mutex mutex_;
  RecentKeys<Made> made_ ABSL_GUARDED_BY(mutex_){32};  // by all that they depend on
};

}  // namespace myograde::server
