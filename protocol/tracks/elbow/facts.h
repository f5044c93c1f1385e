// What the simulator measured in one episode of the elbow track.
#pragma once

#include <cstdint>
#include <string_view>

namespace myograde {

// The error is |target - angle| at the end of a control step of 0.02 s.
struct ElbowFacts {
  static constexpr std::string_view kTrack = "elbow";

  double start_angle = 0;       // rad, of the elbow after the reset
  double target_angle = 0;      // rad
  double final_error = 0;       // rad, at the end (before the first step: at the start)
  double smallest_error = 0;    // rad, over the steps (before the first: at the start)
  double error_sum = 0;         // rad, summed over steps
  int64_t tolerance_steps = 0;  // steps with an error of at most `tolerance_rad`
  int64_t longest_run = 0;      // the most of them in a row
  bool held = false;            // there were `hold_steps` of them in a row
  bool solved = false;          // the official `solved` flag at the last step
  int64_t solved_steps = 0;     // steps with the official flag
  double effort_sum = 0;        // sum over steps of |activations| / 6
  double reported_time = 0;     // s, simulated time that the official code reports last
};

// Calls visit(key, field) for every field, in the order of the record.
template <typename Facts, typename Visitor>
void VisitElbow(Facts& facts, Visitor&& visit) {
  visit("start_angle", facts.start_angle);
  visit("target_angle", facts.target_angle);
  visit("final_error", facts.final_error);
  visit("smallest_error", facts.smallest_error);
  visit("error_sum", facts.error_sum);
  visit("tolerance_steps", facts.tolerance_steps);
  visit("longest_run", facts.longest_run);
  visit("held", facts.held);
  visit("solved", facts.solved);
  visit("solved_steps", facts.solved_steps);
  visit("effort_sum", facts.effort_sum);
  visit("reported_time", facts.reported_time);
}

}  // namespace myograde
