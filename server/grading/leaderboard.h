// Leaderboards: a pure function of the store's rows of finished evaluations and marks. The store's
// change counter tells whether a cached board is stale. By the same rules an evaluation's episodes
// have an order.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "scoring/aggregate.h"
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

// Whether an aggregate has every number that the track ranks by; one of another version may not.
bool HasRankedNumbers(const scoring::ScoredTrack& track, const nlohmann::json& aggregate);

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

// The first 12 digits of the SHA-256 over what a build simulates with: the simulator, MuJoCo's
// library and the models of an evaluation's grader_json, as canonical JSON. "": it is not JSON
// object.
std::string SimulatingBuild(std::string_view grader_json);

// Which build of the grader the rows of a board were played by.
struct BoardBuilds {
  struct Count {
    std::string build;
    size_t rows = 0;
  };
  std::vector<std::string> of_rows;
  // The board's own first, which most rows are of; of equally many, the one of the newest
  // evaluation.
  std::vector<Count> counts;

  // "": the board is empty.
  std::string own() const { return counts.empty() ? "" : counts.front().build; }
};

// Of rows whose evaluations have these ids and builds.
BoardBuilds CountBuilds(const std::vector<int64_t>& evaluations,
                        const std::vector<std::string>& graders);

// The end of an episode and the reason of its failure, where it is a phantom: a trial that the
// official code counts and ends at once, because the one before was solved.
inline constexpr std::string_view kPhantom = "phantom";

// The indices of `episodes`, first place first, as the track's main board would rank evaluations of
// one episode each, without phantoms; of equal ones the earlier comes first. Those that it would
// not rank, the faults, come last. InvalidArgumentError if an index occurs twice.
absl::StatusOr<std::vector<int64_t>> EpisodesInOrder(
    const scoring::TrackScoring& scoring, const std::vector<scoring::JudgedEpisode>& episodes);

struct PickedEpisode {
  std::string_view place;  // "best", "median", "worst"; "only"
  int64_t index = 0;
};

// The first, the one in the middle (of an even number the better one) and the last of an order; of
// two the first and the last; of one that one.
std::vector<PickedEpisode> BestMedianWorst(const std::vector<int64_t>& order);

}  // namespace myograde::server
