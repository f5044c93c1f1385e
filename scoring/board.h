// The leaderboards: which submission stands above which, and why.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include <absl/status/statusor.h>

#include "scoring/aggregate.h"

namespace myograde::scoring {

// One submission's full evaluation, as far as ranking looks at it.
struct BoardEntry {
  std::string submission;  // id
  std::string team;
  int64_t acceptance = 0;  // number of its acceptance: unique, the last tie-break
  bool chosen = false;     // by its team, for TeamRule::kChosen
  bool failed = false;     // Aggregate::failed: not on the board
  int64_t successes = 0;
  int64_t episodes = 0;
  // The means of the track's ranked metrics, in their order; none ranks behind every number.
  std::vector<std::optional<double>> numbers = {};
};

// Whether both succeeded at the same rate, without rounding.
bool EqualRates(const BoardEntry& a, const BoardEntry& b);

// The entry of an evaluation; the caller names submission, team, acceptance and choice.
BoardEntry MakeEntry(std::span<const Metric> metrics, const Aggregate& aggregate);

// Boards name the numbers that they rank by: places in BoardEntry::numbers.
enum class BandsOver { kTime, kSuccess };

// What decides where success rates below the line are exactly equal: mean time, then effort,
// less is better; or the acceptance at once.
enum class Ties { kTime, kAcceptance };

// (1) all with successes/episodes >= line_successes/line_episodes above all others; (2) below
// that line the success rate, then `ties`; (3) above it bands, then effort, less is better.
// Bands over time: in order of time the fastest not yet placed opens a band of all whose time
// is at most band_factor times its own. Bands over success: in order of success rate the best
// not yet placed opens a band of all whose rate times band_factor is at least its own.
struct TieredBoard {
  int64_t line_successes = 90;
  int64_t line_episodes = 100;
  BandsOver bands = BandsOver::kTime;
  double band_factor = 1.1;
  Ties ties = Ties::kTime;
  size_t time = 0;
  size_t effort = 1;
};

// (1) mean distance, more is better; (2) where it is equal and at least time_from_m: mean time,
// less is better. With band = 0 equal means exactly equal. With a larger one, from time_from_m
// on: in order of distance the farthest not yet placed opens a band of all whose distance times
// (1 + band) is at least its own; inside a band time decides, then distance.
struct DistanceBoard {
  double time_from_m = 20;
  double band = 0;
  size_t distance = 0;
  size_t time = 1;
};

// Whether pain and effort are means over all steps of an evaluation, in which an episode that
// ends at once weighs next to nothing, or means of its episodes' means.
enum class MeansOver { kSteps, kEpisodes };

// Only those with mean distance >= qualify_m: (1) pain, (2) effort, less is better.
struct PhysiologicalBoard {
  double qualify_m = 20;
  MeansOver means = MeansOver::kSteps;  // which `pain` and `effort` are
  size_t distance = 0;
  size_t pain = 1;
  size_t effort = 2;
};

// (1) mean score, more is better; (2) where it is exactly equal: effort, less is better.
struct ScoreBoard {
  size_t score = 0;
  size_t effort = 1;
};

using BoardRules = std::variant<TieredBoard, DistanceBoard, PhysiologicalBoard, ScoreBoard>;

// Which of its submissions a team stands with. kBest: the one that ranks best on the board of all
// teams' entries; where bands depend on who stands, as standing.h decides it. kLast: the one
// accepted last. kChosen: the chosen one (of several the last accepted); a team that chose none is
// not on the board.
enum class TeamRule { kBest, kLast, kChosen };

struct RankedEntry {
  BoardEntry entry;
  int64_t rank = 0;   // from 1, without gaps
  // Tiered boards: number of the band above the line, from 0 (-1: below the line), and what
  // opened it: the fastest mean time (s) or the best success rate in it. Distance boards: the
  // same of those from time_from_m on, and the largest mean distance (m).
  int64_t band = -1;
  double band_opener = 0;
};

// The board: every team's entry, first place first. A function of the set of
// entries alone: their order does not matter. Numbers must be finite and acceptance numbers
// unique (InvalidArgumentError names the submission).
absl::StatusOr<std::vector<RankedEntry>> Rank(const std::vector<BoardEntry>& entries,
                                              const BoardRules& rules, TeamRule team_rule);

// Why `above` stands above `below`, two entries of one board as Rank made it: one sentence with ranks and
// names of teams (rank 0: a baseline). `metrics`: the track's, whose digits its numbers have; numbers that
// differ and would look alike have more.
std::string Explain(const RankedEntry& above, const RankedEntry& below, const BoardRules& rules,
                    std::span<const Metric> metrics);

// What the rows of a band have in common, and what decides among them, in a few words; "": the board has no
// bands. Rows with the same RankedEntry::band have the same words.
std::string DescribeBand(const RankedEntry& ranked, const BoardRules& rules,
                         std::span<const Metric> metrics);

// True if an entry is at or above the line that the board draws.
bool IsQualified(const BoardEntry& entry, const BoardRules& rules);

// The order of a board under `rules` in a few sentences, for those who read it.
std::string DescribeOrder(const BoardRules& rules);

}  // namespace myograde::scoring
