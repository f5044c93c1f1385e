// What Baoding balls are judged and ranked by.
#pragma once

#include <cstdint>

#include "scoring/score.h"

namespace myograde::scoring {

const ScoredTrack& ScoredBaoding();

struct BaodingJudging {
  int64_t horizon_steps = 200;  // that the score is a share of, however few were played
  int64_t solved_steps = 6;     // steps of 0.025 s with the official flag that make a success
};

// The place of its own metric; the score is the steps with the official flag / horizon.
struct BaodingMetric : ScoreMetric {
  static constexpr size_t kDistance = kOwn;  // m, mean over the steps of both balls' distances
};

// See JudgeByScore.
Verdict Judge(const EpisodeFacts& facts, const BaodingJudging& rules);

}  // namespace myograde::scoring
