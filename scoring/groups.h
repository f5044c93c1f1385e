// Which places of a board its episodes decide, and which are so close that luck may have ordered
// them.
//
// Two rows are compared by the number that ranks one above the other (CriterionOf), in a paired test
// (paired_test.h) over the episodes that both played. Of `places` first rows every pair is tested:
// who stands first is itself taken from the results, so the best of many equals always looks better
// than the worst of them, and testing neighbours alone would find that decided too often. Holm's
// correction (S. Holm, A simple sequentially rejective multiple test procedure, 1979) over all these
// tests makes the chance of even one false decision at most `level`.
//
// Further episodes are another look at the same pair. Where they may follow, look k of a pair has
// level / 2^k to decide: p-values are multiplied by 2^k before Holm's correction. All looks together
// have at most `level` (Bonferroni), whatever of the earlier ones made somebody ask for more.
//
// A group opens with its first row and holds the rows below it as long as their test against the
// opener decides nothing. The next row opens a group.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <span>
#include <vector>

#include "scoring/aggregate.h"
#include "scoring/board.h"
#include "scoring/metric.h"
#include "scoring/paired_test.h"

namespace myograde::scoring {

struct GroupRules {
  double level = 0.05;
  int64_t samples = 10'000;  // TestPairs
  int64_t places = 10;       // how many first rows are tested
  bool further_looks = false;  // further episodes may be played

  bool operator==(const GroupRules&) const = default;
};

inline constexpr int64_t kMostTestedPlaces = 50;
inline constexpr int64_t kMostSamples = 1'000'000;

// The fewest samples with which a test of a full board can still decide: the smallest p-value of
// random samples is 1 / (1 + samples), and Holm's correction divides the level by the tests.
int64_t FewestSamples(double level, int64_t places);

// What ranks one row above another.
struct Criterion {
  enum class Kind {
    kSuccess,     // the success rate
    kNumber,      // a ranked number
    kAcceptance,  // all numbers are equal: nothing to test
  };
  Kind kind = Kind::kAcceptance;
  size_t number = 0;  // place in BoardEntry::numbers

  bool operator==(const Criterion&) const = default;
};

// Tiered boards: the success rate where one of the two stands below the line, and between bands of
// it; the time between bands of that; effort inside a band. Below the line where rates are equal,
// time and then effort, if the board's ties say so. Distance boards: the distance; the time inside a
// band, or where distances are equal and time counts. Physiological boards: pain, and where it is
// equal effort. Where a number is equal the next one decides, and at last the acceptance.
Criterion CriterionOf(const RankedEntry& above, const RankedEntry& below, const BoardRules& rules);

// What decides among the rows of a band, or where a board has none among all of them: effort or time inside a
// band, successes below the line of a tiered board, the distance outside bands, pain, the score.
Criterion CriterionWithin(const RankedEntry& ranked, const BoardRules& rules);

// A row with the episodes that are compared: those that it is ranked by, and perhaps further ones.
// The same index is the same episode in every row.
struct TestedRow {
  RankedEntry ranked;
  std::vector<JudgedEpisode> episodes;
  // How many further episodes it had after each time that some were added. Two rows have the same
  // first ones.
  std::set<int64_t> further = {};
};

// One row against another that stands above it.
struct PlaceTest {
  Criterion criterion;
  PairedTest test;        // a: the upper row
  int64_t looks = 1;      // at this pair, with this one
  double p_adjusted = 1;  // by its looks and Holm; at most `level` if the test decides
  bool decided = false;   // the upper row is better
  bool reversed = false;  // the lower row is better, which further episodes can show
};

struct PlaceInGroup {
  int64_t group = 1;                // from 1
  std::optional<PlaceTest> above;   // against the row above it; the first row has none
  std::optional<PlaceTest> opener;  // against the row that decided its group: that of the group
                                    // above it if it opened one itself
  size_t opened_by = 0;             // the place of that row
};

struct Groups {
  std::vector<PlaceInGroup> places;  // of the tested rows, in their order
  int64_t tests = 0;                 // that the correction is over
  bool stopped = false;              // it was given up, and the rest is empty
};

// `rows`: of a board by Rank under `rules`, in its order; those after the first GroupRules::places
// are ignored. `metrics`: the track's. Episodes of one row must have different indices. A function
// of its arguments alone; neither the order of episodes nor the board's other rows matter. `stopped`
// is asked between tests: true gives it up.
Groups FormGroups(std::span<const Metric> metrics, std::span<const TestedRow> rows,
                  const BoardRules& rules, const GroupRules& group_rules,
                  const std::function<bool()>& stopped = {});

// The numbers that can rank a board's rows, the first first: success rate, or numbers by their place
// in BoardEntry::numbers.
std::vector<Criterion> ListCriteria(const BoardRules& rules);

// The metric behind a number of a BoardEntry.
const Metric& MetricOf(std::span<const Metric> metrics, size_t number);

// The 95 % interval of a mean over steps, from the error of a ratio of two sums over episodes
// (W. G. Cochran, Sampling Techniques, 3rd edition, 1977, section 2.11). The intervals of success
// rates and plain means are those of Aggregate. nullopt: `number` is no mean over steps, or there
// are fewer than two episodes, or no steps.
std::optional<Spread> SpreadOverSteps(std::span<const Metric> metrics, size_t number,
                                      std::span<const JudgedEpisode> episodes);

}  // namespace myograde::scoring
