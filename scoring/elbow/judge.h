// From the facts of one elbow episode to its verdict and its metrics.
#pragma once

#include <cstdint>

#include "protocol/base/episode_facts.h"
#include "scoring/judge.h"

namespace myograde::scoring {

// What makes an elbow episode a success.
enum class ElbowSuccess {
  kHeld,    // it ended because the target was held
  kSolved,  // the official flag was up in at least `solved_steps` steps, in a row or not
};

struct ElbowJudging {
  ElbowSuccess success = ElbowSuccess::kHeld;
  int64_t solved_steps = 6;  // control steps of 0.02 s
  TimeSource time = TimeSource::kPlayed;
  double full_time_s = 2;    // s, counted for failures and the participant's faults
};

// A fault has the outcome that its evidence names. An episode that was played is a success by the
// rule above, however it ended; else it failed by how it ended: time or given-up. Facts that
// contradict themselves (an end that the track does not have, held without having held) are
// kGraderError. Time: see TimeSource. Effort: mean over the steps of |activations| / 6.
Judgement Judge(const EpisodeFacts& facts, const ElbowJudging& rules);

}  // namespace myograde::scoring
