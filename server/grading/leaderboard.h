// Leaderboards: a pure function of what the store has of finished evaluations and
// marks. Kept answers are told from stale ones by the store's count of changes.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "scoring/board.h"
#include "server/store/damage.h"
#include "server/store/rows.h"

namespace myograde::server {

inline constexpr char kHidden[] = "hidden";
inline constexpr char kDisqualified[] = "disqualified";
inline constexpr char kBaseline[] = "baseline";

// The marks in force, by submission and name.
using Marks = std::map<int64_t, std::map<std::string, MarkRow>>;

struct LeaderboardRow {
  scoring::RankedEntry ranked;  // rank 0: a baseline, which has none
  StandingRow source;
  nlohmann::json aggregate;     // AggregateToJson
  bool qualified = false;       // at or above the board's line
};

struct DisqualifiedRow {
  StandingRow source;
  nlohmann::json aggregate;
  MarkRow mark;
};

struct Leaderboard {
  std::vector<LeaderboardRow> rows;                 // in the board's order, baselines among them
  std::vector<DisqualifiedRow> disqualified;  // by submission
  std::vector<Damage> damaged;                // what would be here, and can't be read
};

// Hidden submissions are as if they weren't there. Disqualified ones don't rank
// and are listed apart. A baseline stands before the first ranked row that it
// would beat, and neither takes a rank nor moves a band: the ranks are those of
// the board without baselines. Every submission marked as baseline is shown; its
// team's others rank as usual. What has an aggregate that can't be read is as if it weren't
// there, and told apart.
absl::StatusOr<Leaderboard> MakeLeaderboard(const std::vector<StandingRow>& standings, const Marks& marks,
                                const scoring::BoardRules& rules, scoring::TeamRule team);

// Why one of two stands above the other, in a sentence with unrounded numbers.
// Each is named by its submission's number, or else by its team. A NotFoundError
// says which is not on the board and why.
struct Explanation {
  LeaderboardRow above;
  LeaderboardRow below;
  std::string sentence;
};
absl::StatusOr<Explanation> ExplainOrder(const std::vector<StandingRow>& standings,
                                         const Marks& marks, const scoring::BoardRules& rules,
                                         scoring::TeamRule team, const std::string& a,
                                         const std::string& b);

}  // namespace myograde::server
