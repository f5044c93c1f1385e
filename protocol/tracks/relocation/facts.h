// What the simulator measures in an episode of relocation, and the names of its endings.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "protocol/tracks/dropped.h"

namespace myograde {

using RelocationEnd = DroppedEnd;  // the object is too far from the palm
using RelocationReason = DroppedReason;

// The errors and the reach are the lengths of the official 'pos_err', 'rot_err' and 'reach_err' at
// the end of a control step of 0.01 s.
struct RelocationFacts {
  static constexpr std::string_view kTrack = "relocation";
  static constexpr std::array kEnds = {RelocationEnd::kDropped};
  static constexpr std::array kReasons = {RelocationReason::kDropped};
  static constexpr int kActionSize = 63;

  double final_position_error = 0;     // m, at the end (before the first step: at the start)
  double smallest_position_error = 0;  // m, over the steps (before the first: at the start)
  double final_rotation_error = 0;     // rad, at the end
  double final_reach = 0;              // m, at the end, from the object to the palm
  double smallest_reach = 0;           // m, over the steps
  bool solved = false;                 // the official `solved` flag at the last step
  int64_t solved_steps = 0;            // steps with the official flag
  double effort_sum = 0;               // sum over steps of |activations| / 63

  // Visits every fact with its JSON key; `self` may be const.
  template <typename Self, typename Visitor>
  static void Visit(Self& self, Visitor&& visit) {
    visit("final_position_error", self.final_position_error);
    visit("smallest_position_error", self.smallest_position_error);
    visit("final_rotation_error", self.final_rotation_error);
    visit("final_reach", self.final_reach);
    visit("smallest_reach", self.smallest_reach);
    visit("solved", self.solved);
    visit("solved_steps", self.solved_steps);
    visit("effort_sum", self.effort_sum);
  }
};

}  // namespace myograde
