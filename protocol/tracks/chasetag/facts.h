// What the simulator measures in an episode of chase-tag, and the names of its endings.
#pragma once

#include <array>
#include <string_view>

#include "protocol/base/outcome.h"

namespace myograde {

struct ChaseTagEnd {
  static constexpr EpisodeEnd kFell{"fell"};
  static constexpr EpisodeEnd kCaught{"caught"};  // the opponent reached the evader
  static constexpr EpisodeEnd kOutOfBounds{"out-of-bounds"};
  static constexpr EpisodeEnd kTagged{"tagged"};  // the chaser reached the opponent
};

struct ChaseTagReason {
  static constexpr FailureReason kFell{"fell"};
  static constexpr FailureReason kCaught{"caught"};
  static constexpr FailureReason kOutOfBounds{"out-of-bounds"};
};

// Distances are in the plane, from the pelvis to the opponent, at the end of a control step of
// 0.01 s.
struct ChaseTagFacts {
  static constexpr std::string_view kTrack = "chasetag";
  static constexpr std::array kEnds = {ChaseTagEnd::kFell, ChaseTagEnd::kCaught,
                                       ChaseTagEnd::kOutOfBounds, ChaseTagEnd::kTagged};
  // The last end is no failure.
  static constexpr std::array kReasons = {ChaseTagReason::kFell, ChaseTagReason::kCaught,
                                          ChaseTagReason::kOutOfBounds};
  static constexpr int kActionSize = 80;

  bool evades = false;           // the task: false is CHASE, true is EVADE
  int opponent = 0;              // its policy: 0 at the edge, 1 stationary, 2 random, 3 repelled, 4
                                 // chasing
  double final_distance = 0;     // m, at the end (before the first step: at the start)
  double smallest_distance = 0;  // m, over the steps (before the first: at the start)
  bool solved = false;           // the official `solved` flag at the last step
  double reported_time = 0;      // s, official reported time (20.0 for a lost chase)
  double effort_sum = 0;         // sum over steps of |activations| / 80

  // Visits every fact with its JSON key; `self` may be const.
  template <typename Self, typename Visitor>
  static void Visit(Self& self, Visitor&& visit) {
    visit("evades", self.evades);
    visit("opponent", self.opponent);
    visit("final_distance", self.final_distance);
    visit("smallest_distance", self.smallest_distance);
    visit("solved", self.solved);
    visit("reported_time", self.reported_time);
    visit("effort_sum", self.effort_sum);
  }
};

}  // namespace myograde
