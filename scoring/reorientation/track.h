// What die reorientation is judged and ranked by.
#pragma once

#include <cstdint>

#include "scoring/track.h"

namespace myograde::scoring {

const ScoredTrack& ScoredReorientation();

struct ReorientationJudging {
  int64_t solved_steps = 6;  // steps of 0.01 s with the official flag that make a success
};

// Places of the metrics in Verdict::metrics and in the track's list.
struct ReorientationMetric {
  enum Place : size_t {
    kScore,          // 1 for a success, else 0: its mean is the official score
    kEffort,         // mean over the steps of |activations| / 39; none without a step
    kEffortSum,      // the same, summed
    kTime,           // s, of simulated time
    kPositionError,  // m, at the end
    kRotationError,  // rad, at the end
    kCount,
  };
};

// A fault has the outcome that its evidence names. An episode that was played is a success by the
// rule above, however it ended; else it failed by how it ended: time, dropped or given-up. An end
// that the track does not have is kGraderError.
Verdict Judge(const EpisodeFacts& facts, const ReorientationJudging& rules);

}  // namespace myograde::scoring
