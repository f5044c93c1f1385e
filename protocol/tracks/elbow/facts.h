// What the simulator measures in an episode of elbow, and the names of its endings.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "protocol/base/outcome.h"

namespace myograde {

struct ElbowEnd {
  static constexpr EpisodeEnd kHeld{"held"};  // the target was held
};

// The error is |target - angle| at the end of a control step of 0.02 s.
struct ElbowFacts {
  static constexpr std::string_view kTrack = "elbow";
  static constexpr std::array kEnds = {ElbowEnd::kHeld};
  static constexpr std::array<FailureReason, 0> kReasons = {};  // none of its own
  static constexpr int kActionSize = 6;

  double start_angle = 0;       // rad, the elbow's angle after the reset
  double target_angle = 0;      // rad
  double final_error = 0;       // rad, at the end (before the first step: at the start)
  double smallest_error = 0;    // rad, over the steps (before the first: at the start)
  double error_sum = 0;         // rad, summed over steps
  int64_t tolerance_steps = 0;  // steps with an error of at most `tolerance_rad`
  int64_t longest_run = 0;      // the longest run of them
  bool held = false;            // `hold_steps` of them in a row were reached
  bool solved = false;          // the official `solved` flag at the last step
  int64_t solved_steps = 0;     // steps with the official flag
  double effort_sum = 0;        // sum over steps of |activations| / 6
  double reported_time = 0;     // s, the official code's last reported simulated time

  // Visits every fact with its JSON key; `self` may be const.
  template <typename Self, typename Visitor>
  static void Visit(Self& self, Visitor&& visit) {
    visit("start_angle", self.start_angle);
    visit("target_angle", self.target_angle);
    visit("final_error", self.final_error);
    visit("smallest_error", self.smallest_error);
    visit("error_sum", self.error_sum);
    visit("tolerance_steps", self.tolerance_steps);
    visit("longest_run", self.longest_run);
    visit("held", self.held);
    visit("solved", self.solved);
    visit("solved_steps", self.solved_steps);
    visit("effort_sum", self.effort_sum);
    visit("reported_time", self.reported_time);
  }
};

}  // namespace myograde
