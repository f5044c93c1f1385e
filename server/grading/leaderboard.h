// Leaderboards: a pure function of the store's rows of finished evaluations and marks. The store's
// change counter tells whether a cached board is stale.
#pragma once

#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "scoring/board.h"
#include "scoring/track.h"
#include "server/board/board_state.h"

namespace myograde::server {

struct LeaderboardRow {
  scoring::RankedEntry ranked;  // rank 0: a baseline, which is not ranked
  StandingRow source;
  bool qualified = false;       // at or above the board's qualifying line
};

struct DisqualifiedRow {
  StandingRow source;
  MarkRow mark;
};

struct Leaderboard {
  std::vector<LeaderboardRow> rows;           // in board order, including baselines
  std::vector<DisqualifiedRow> disqualified;  // by submission
};

// Hidden submissions are left out. Disqualified ones don't rank and are listed separately. A
// baseline stands before the first ranked row that it would beat, and neither takes a rank nor
// moves a band: the ranks are those of the board without baselines. Every submission marked as
// baseline is shown; its team's others rank as usual.
absl::StatusOr<Leaderboard> MakeLeaderboard(const std::vector<StandingRow>& standings,
                                            const Marks& marks, const scoring::BoardRules& rules,
                                            const scoring::TrackScoring& scoring);

// The keys that answers and copies of the record have of each row, and of both lists.
nlohmann::json RowToJson(const LeaderboardRow& row);
nlohmann::json BoardToJson(const Leaderboard& board);

// Why one of two entries stands above the other, in a sentence (scoring::Explain). Each is
// identified by its submission's number, or else by its team. A NotFoundError says which one is not
// on the board and why.
struct Explanation {
  LeaderboardRow above;
  LeaderboardRow below;
  std::string sentence;
};
absl::StatusOr<Explanation> ExplainOrder(const std::vector<StandingRow>& standings,
                                         const Marks& marks, const scoring::BoardRules& rules,
                                         const scoring::TrackScoring& scoring,
                                         const std::string& a, const std::string& b);

}  // namespace myograde::server
