// What chase-tag is judged and ranked by.
#pragma once

#include "scoring/score.h"

namespace myograde::scoring {

const ScoredTrack& ScoredChaseTag();

struct ChaseTagJudging {
  double full_time_s = 20;
};

// Places of its own metrics.
struct ChaseTagMetric : ScoreMetric {
  enum Own : size_t {
    kReportedTime = kOwn,  // s, the official code's time
    kFinalDistance,        // m, at the end, from the pelvis to the opponent
  };
};

// See JudgeByScore. With t the episode's time in s, to hundredths: a tag scores 1 - t /
// full_time_s, a lost chase 0; evading scores t / full_time_s, however the episode ended, unless
// the policy gave up.
Verdict Judge(const EpisodeFacts& facts, const ChaseTagJudging& rules);

}  // namespace myograde::scoring
