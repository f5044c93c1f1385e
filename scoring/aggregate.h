// From the episodes of an evaluation to the numbers that rank it.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <absl/status/statusor.h>

#include "scoring/metric.h"
#include "scoring/verdict.h"

namespace myograde::scoring {

struct JudgedEpisode {
  int64_t index = 0;  // in the evaluation
  Verdict verdict;
};

// How far episodes lie apart; for people, never ranked.
struct Spread {
  double deviation = 0;  // standard deviation of the sample (n - 1), 0 for fewer than two
  double low = 0;        // 95 % interval of the mean
  double high = 0;
};

// The mean of one metric over `count` episodes.
struct Mean {
  double value = 0;   // unrounded
  int64_t count = 0;  // episodes that have the metric; value is 0 if there is none
  Spread spread;
};

struct Aggregate {
  int64_t episodes = 0;    // with a result: neither cancelled nor the grader's fault
  int64_t successes = 0;
  int64_t participant_faults = 0;
  bool failed = false;     // every episode is a participant's fault (or there is none): no rank
  Spread success_spread;   // of the success rate: Wilson's interval
  // In the order of the track's metrics. Of one over steps, count is 1 and there is no spread.
  std::vector<Mean> means;

  // k/n for display; ranking compares the whole numbers.
  double success_rate() const {
    return episodes == 0 ? 0 : static_cast<double>(successes) / static_cast<double>(episodes);
  }
};

// Sums in the order of the episodes' indices, so the same episodes in any order give the same
// bits. Cancelled episodes and the grader's faults have no result and are left out.
// `metrics` are those of the track, and each verdict has as many.
// InvalidArgumentError if two rows have the same index or an index is negative.
absl::StatusOr<Aggregate> AggregateEpisodes(std::span<const Metric> metrics,
                                            std::vector<JudgedEpisode> episodes);

}  // namespace myograde::scoring
