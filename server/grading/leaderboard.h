// Leaderboards: a pure function of the store's rows of finished evaluations and marks. The store's
// change counter tells whether a cached board is stale.
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
  scoring::RankedEntry ranked;  // rank 0: a baseline, which is not ranked
  StandingRow source;
  nlohmann::json aggregate;     // AggregateToJson
  bool qualified = false;       // at or above the board's qualifying line
};

struct DisqualifiedRow {
  StandingRow source;
  nlohmann::json aggregate;
  MarkRow mark;
};

struct Leaderboard {
  std::vector<LeaderboardRow> rows;                 // in board order, including baselines
  std::vector<DisqualifiedRow> disqualified;  // by submission
  std::vector<Damage> damaged;                // rows that belong here but are unreadable
};

// Hidden submissions are left out. Disqualified ones don't rank and are listed separately. A
// baseline stands before the first ranked row that it would beat, and neither takes a rank nor
// moves a band: the ranks are those of the board without baselines. Every submission marked as
// baseline is shown; its team's others rank as usual. A submission with an unreadable aggregate is
// left out of the board and listed as damaged.
absl::StatusOr<Leaderboard> MakeLeaderboard(const std::vector<StandingRow>& standings, const Marks& marks,
                                const scoring::BoardRules& rules, scoring::TeamRule team);

// Why one of two entries stands above the other, in a sentence with unrounded numbers. Each is
// identified by its submission's number, or else by its team. A NotFoundError says which one is not
// on the board and why.
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
