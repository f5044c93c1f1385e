// What relocation is judged and ranked by.
#pragma once

#include <cstdint>

#include "scoring/score.h"

namespace myograde::scoring {

const ScoredTrack& ScoredRelocation();

struct RelocationJudging {
  int64_t solved_steps = 6;  // steps of 0.01 s with the official flag that make a success
};

// Places of its own metrics; the score is 1 for a success, else 0.
struct RelocationMetric : ScoreMetric {
  enum Own : size_t {
    kPositionError = kOwn,  // m, at the end
    kReach,                 // m, at the end, from the object to the palm
  };
};

// See JudgeByScore.
Verdict Judge(const EpisodeFacts& facts, const RelocationJudging& rules);

}  // namespace myograde::scoring
