// From the facts of an episode of elbow to its verdict and its metrics.
#pragma once

#include <cstdint>

#include "scoring/verdict.h"

namespace myograde::scoring {

// What makes an elbow episode a success.
enum class ElbowSuccess {
  kHeld,    // it ended because the target was held
  kSolved,  // the official flag was up in at least `solved_steps` steps, in a row or not
};

struct ElbowJudging {
  ElbowSuccess success = ElbowSuccess::kHeld;
  int64_t solved_steps = 6;  // control steps of 0.02 s
  TimeSource time = TimeSource::kPlayed;  // a failure counts full_time_s
  double full_time_s = 2;    // s, counted for failures and the participant's faults
};

// Places of the metrics in Verdict::metrics and in the track's list.
struct ElbowMetric {
  enum Place : size_t {
    kTime,          // s
    kEffort,        // mean over the steps of |activations| / 6; none without a step
    kEffortSum,     // the same, summed
    kReportedTime,  // s, the official code's time
    kFinalError,    // rad, |target - angle| at the end
    kCount,
  };
};

// A fault has the outcome that its evidence names. An episode that was played is a success by the
// rule above, however it ended; else it failed by how it ended: time or given-up. Facts that
// contradict themselves (an end that the track does not have, held without having held) are
// kGraderError.
Verdict Judge(const EpisodeFacts& facts, const ElbowJudging& rules);

}  // namespace myograde::scoring
