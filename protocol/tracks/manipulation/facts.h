// What the simulator measures in an episode of manipulation, and the names of its endings.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "protocol/base/outcome.h"

namespace myograde {

struct ManipulationEnd {
  static constexpr EpisodeEnd kPlaced{"placed"};    // the profile's end condition was met
  static constexpr EpisodeEnd kDropped{"dropped"};  // object below the drop height
  static constexpr EpisodeEnd kPhantom{"phantom"};  // as-graded only: ended by the previous
                                                    // episode's stale flag (D18)
};

struct ManipulationReason {
  static constexpr FailureReason kDropped{"dropped"};    // object below the drop height
  static constexpr FailureReason kForce{"force"};        // contact force above the limit
                                                         // ('throwing')
  static constexpr FailureReason kHandover{"handover"};  // a limb's contact was too short, or the
                                                         // goal was not held
  static constexpr FailureReason kContact{"contact"};    // the object touched something forbidden
  static constexpr FailureReason kPhantom{"phantom"};    // as-graded only: ended at once by the
                                                         // previous episode
};

// Frames are control steps (100 Hz), counted over the episode and including
// the frame of the reset where the profile counts it.
struct ManipulationFacts {
  static constexpr std::string_view kTrack = "manipulation";
  static constexpr std::array kEnds = {ManipulationEnd::kPlaced, ManipulationEnd::kDropped,
                                       ManipulationEnd::kPhantom};
  static constexpr std::array kReasons = {
      ManipulationReason::kDropped, ManipulationReason::kForce, ManipulationReason::kHandover,
      ManipulationReason::kContact, ManipulationReason::kPhantom};
  static constexpr int kActionSize = 80;

  int64_t frames = 0;             // frames examined
  int64_t frames_arm = 0;         // object touched the muscle arm
  int64_t frames_prosthesis = 0;
  int64_t frames_start = 0;       // start pillar
  int64_t frames_goal = 0;        // goal pillar
  int64_t frames_other = 0;       // anything else
  bool goal_only_at_end = false;  // last `hold_frames` frames touched exactly the goal pillar
  bool placed = false;            // profile's placement held (paper: all of the last 8 frames)
  bool solved = false;            // the official `solved` flag at the last step
  int64_t solved_steps = 0;       // steps with the official flag
  double peak_force = 0;          // N, total normal force on the object, largest over physics steps
  double max_touch = 0;           // N, official max_force: touch sensor at control rate
  double goal_distance_sum = 0;   // m, summed over steps (official goal_dist)
  double final_goal_distance = 0;       // m, official goal_dist at the end
  double final_hand_distance = 0;       // m, |palm - object| at the end
  double max_height = 0;                // m, largest height of the object above its height at start
  double effort_sum = 0;          // sum over steps of |activations| / 63
  double reported_time = 0;       // s, official reported time (10.0 after a drop)

  // Visits every fact with its JSON key; `self` may be const.
  template <typename Self, typename Visitor>
  static void Visit(Self& self, Visitor&& visit) {
    visit("frames", self.frames);
    visit("frames_arm", self.frames_arm);
    visit("frames_prosthesis", self.frames_prosthesis);
    visit("frames_start", self.frames_start);
    visit("frames_goal", self.frames_goal);
    visit("frames_other", self.frames_other);
    visit("goal_only_at_end", self.goal_only_at_end);
    visit("placed", self.placed);
    visit("solved", self.solved);
    visit("solved_steps", self.solved_steps);
    visit("peak_force", self.peak_force);
    visit("max_touch", self.max_touch);
    visit("goal_distance_sum", self.goal_distance_sum);
    visit("final_goal_distance", self.final_goal_distance);
    visit("final_hand_distance", self.final_hand_distance);
    visit("max_height", self.max_height);
    visit("effort_sum", self.effort_sum);
    visit("reported_time", self.reported_time);
  }
};

}  // namespace myograde
