// What is measured in an episode of locomotion besides its facts.
#pragma once

#include <array>
#include <optional>
#include <string_view>

#include "protocol/tracks/details.h"

namespace myograde {

struct LocomotionDetails {
  static constexpr std::string_view kTrack = "locomotion";
  // Kinds of obstacles.
  static constexpr std::array<std::string_view, 3> kObstacles = {"hilly", "rough", "stairs"};
  // The joints whose limit torque is pain, in the official order.
  static constexpr std::array<std::string_view, 12> kPainJoints = {
      "hip_adduction_l",        "hip_adduction_r",        "hip_flexion_l", "hip_flexion_r",
      "hip_rotation_l",         "hip_rotation_r",         "knee_angle_l",  "knee_angle_l_rotation2",
      "knee_angle_l_rotation3", "mtp_angle_l",            "ankle_angle_l", "subtalar_angle_l"};
  // These, and the two of the prosthesis.
  static constexpr std::array<std::string_view, 14> kJoints = {
      "hip_adduction_l",        "hip_adduction_r",        "hip_flexion_l", "hip_flexion_r",
      "hip_rotation_l",         "hip_rotation_r",         "knee_angle_l",  "knee_angle_l_rotation2",
      "knee_angle_l_rotation3", "mtp_angle_l",            "ankle_angle_l", "subtalar_angle_l",
      "osl_knee_angle_r",       "osl_ankle_angle_r"};

  // m; the highest obstacle of each kind that was passed, as publications give it: how far the top
  // of a hill or of rough ground is above the level ground before it, and of stairs the height of
  // one step. Passed: the root was beyond its far end. None: no obstacle of this kind was passed.
  std::array<std::optional<double>, 3> obstacle_heights;
  // Sums over steps of (clipped limit torque in N m)/1000; their mean is the fact pain_sum.
  std::array<double, 12> pain_by_joint = {};
  std::array<JointRange, 14> joint_ranges = {};  // rad
  std::optional<double> fall_time;  // s, when the episode ended by a fall
  std::optional<double> fall_y;     // m, where
  double speed_mean = 0;            // m/s along the course: way from the start to the last step by
                                    // simulated time

  // Visits every detail with its JSON key; `self` may be const.
  template <typename Self, typename Visitor>
  static void Visit(Self& self, Visitor&& visit) {
    visit("obstacle_heights", ByName{kObstacles, self.obstacle_heights});
    visit("pain_by_joint", ByName{kPainJoints, self.pain_by_joint});
    visit("joint_ranges", ByName{kJoints, self.joint_ranges});
    visit("fall_time", self.fall_time);
    visit("fall_y", self.fall_y);
    visit("speed_mean", self.speed_mean);
  }
};

}  // namespace myograde
