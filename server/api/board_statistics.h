// Which places of a board its episodes decide (scoring/groups.h), from the store.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "scoring/groups.h"
#include "scoring/statistics_config.h"
#include "server/api/context.h"
#include "server/grading/leaderboard.h"
#include "server/grading/tracks.h"
#include "server/store/reader.h"

namespace myograde::server {

// How the board of a phase ("": of none) tells close places apart.
scoring::StatisticsConfig StatisticsConfigOf(const ApiContext& context, const std::string& phase);

// What is known of one of the first places.
struct TestedPlace {
  size_t row = 0;        // in Leaderboard::rows
  int64_t further = 0;   // further episodes that are part of its tests
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
// out. Reads the episodes of the first places only. DeadlineExceededError: `stopped` was true before
// all tests were made.
absl::StatusOr<BoardStatistics> StatisticsOf(Reader& reader, const Track& track,
                                             const scoring::BoardRules& rules,
                                             const Leaderboard& board,
                                             const scoring::GroupRules& group_rules,
                                             int64_t before_ms,
                                             const std::function<bool()>& stopped = {});

// Where ranks are those of groups: the published rank of each row of the board, 0 for a baseline.
std::vector<int64_t> PublishedRanks(const Leaderboard& board, const BoardStatistics& statistics);

}  // namespace myograde::server
