// What the simulator measures in an episode of die reorientation, and the names of its endings.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "protocol/tracks/dropped.h"

namespace myograde {

using ReorientationEnd = DroppedEnd;  // the die is too far from its place
using ReorientationReason = DroppedReason;

// The errors are the lengths of the official 'pos_err' and 'rot_err' at the end of a control step
// of 0.01 s.
struct ReorientationFacts {
  static constexpr std::string_view kTrack = "reorientation";
  static constexpr std::array kEnds = {ReorientationEnd::kDropped};
  static constexpr std::array kReasons = {ReorientationReason::kDropped};
  static constexpr int kActionSize = 39;

  double final_position_error = 0;     // m, at the end (before the first step: at the start)
  double final_rotation_error = 0;     // rad, likewise
  double smallest_rotation_error = 0;  // rad, over the steps (before the first: at the start)
  bool solved = false;                 // the official `solved` flag at the last step
  int64_t solved_steps = 0;            // steps with the official flag
  double effort_sum = 0;               // sum over steps of |activations| / 39

  // Visits every fact with its JSON key; `self` may be const.
  template <typename Self, typename Visitor>
  static void Visit(Self& self, Visitor&& visit) {
    visit("final_position_error", self.final_position_error);
    visit("final_rotation_error", self.final_rotation_error);
    visit("smallest_rotation_error", self.smallest_rotation_error);
    visit("solved", self.solved);
    visit("solved_steps", self.solved_steps);
    visit("effort_sum", self.effort_sum);
  }
};

}  // namespace myograde
