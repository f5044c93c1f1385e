// What is measured in an episode of manipulation besides its facts.
#pragma once

#include <array>
#include <optional>
#include <string_view>

#include "protocol/tracks/details.h"

namespace myograde {

// Times are s of simulated time; none: it never came to that. What the object touches is looked at
// after each control step (100 Hz) and named as the profile names it.
struct ManipulationDetails {
  static constexpr std::string_view kTrack = "manipulation";
  // The muscle arm's joints that move by themselves, in the order of the model.
  static constexpr std::array<std::string_view, 27> kJoints = {
      "elv_angle",      "shoulder_elv",   "shoulder_rot", "elbow_flexion",  "pro_sup",
      "deviation",      "flexion",        "cmc_abduction", "cmc_flexion",   "mp_flexion",
      "ip_flexion",     "mcp2_flexion",   "mcp2_abduction", "pm2_flexion",  "md2_flexion",
      "mcp3_flexion",   "mcp3_abduction", "pm3_flexion",  "md3_flexion",    "mcp4_flexion",
      "mcp4_abduction", "pm4_flexion",    "md4_flexion",  "mcp5_flexion",   "mcp5_abduction",
      "pm5_flexion",    "md5_flexion"};

  std::optional<double> first_contact_time;  // the arm touches the object for the first time
  std::optional<double> handover_time;       // the prosthesis touches it for the first time after
                                             // the arm did, or at once with it
  std::optional<double> release_time;        // the arm's last touch, if the prosthesis had the
                                             // object without the arm after it
  std::optional<double> goal_contact_time;   // the object touches the goal pillar the first time
  std::optional<double> peak_force_time;     // the total normal force on the object was largest (of
                                             // all physics steps)
  std::array<JointRange, 27> joint_ranges = {};  // rad

  // Visits every detail with its JSON key; `self` may be const.
  template <typename Self, typename Visitor>
  static void Visit(Self& self, Visitor&& visit) {
    visit("first_contact_time", self.first_contact_time);
    visit("handover_time", self.handover_time);
    visit("release_time", self.release_time);
    visit("goal_contact_time", self.goal_contact_time);
    visit("peak_force_time", self.peak_force_time);
    visit("joint_ranges", ByName{kJoints, self.joint_ranges});
  }
};

}  // namespace myograde
