// What the simulator measures in an episode of Baoding balls, and the names of its endings.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "protocol/tracks/dropped.h"

namespace myograde {

using BaodingEnd = DroppedEnd;  // a ball is below the hand
using BaodingReason = DroppedReason;

// Of the states at the end of control steps of 0.025 s.
struct BaodingFacts {
  static constexpr std::string_view kTrack = "baoding";
  static constexpr std::array kEnds = {BaodingEnd::kDropped};
  static constexpr std::array kReasons = {BaodingReason::kDropped};
  static constexpr int kActionSize = 39;

  int64_t direction = 0;     // of the targets' turn: -1 clockwise, 0 none, 1 counter-clockwise
  double distance_sum = 0;   // m, sum over steps of the mean of both balls' distances from targets
  bool solved = false;       // the official `solved` flag at the last step
  int64_t solved_steps = 0;  // steps with the official flag
  double effort_sum = 0;     // sum over steps of |activations| / 39

  // Visits every fact with its JSON key; `self` may be const.
  template <typename Self, typename Visitor>
  static void Visit(Self& self, Visitor&& visit) {
    visit("direction", self.direction);
    visit("distance_sum", self.distance_sum);
    visit("solved", self.solved);
    visit("solved_steps", self.solved_steps);
    visit("effort_sum", self.effort_sum);
  }
};

}  // namespace myograde
