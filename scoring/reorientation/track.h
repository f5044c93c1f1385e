// What die reorientation is judged and ranked by.
#pragma once

#include <cstdint>

#include "scoring/score.h"

namespace myograde::scoring {

const ScoredTrack& ScoredReorientation();

struct ReorientationJudging {
  int64_t solved_steps = 6;  // steps of 0.01 s with the official flag that make a success
};

// Places of its own metrics; the score is 1 for a success, else 0.
struct ReorientationMetric : ScoreMetric {
  enum Own : size_t {
    kPositionError = kOwn,  // m, at the end
    kRotationError,         // rad, at the end
  };
};

// See JudgeByScore.
Verdict Judge(const EpisodeFacts& facts, const ReorientationJudging& rules);

}  // namespace myograde::scoring
