// The numbers and switches of relocation: the "rules" object of a profile in configs/tracks/. One
// implementation reads them all; a profile is nothing but a set of values.
// Lengths in m, angles in rad; a step is a control step of 0.01 s.
#pragma once

#include <absl/status/statusor.h>

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "sim/model/episode_rules.h"

namespace myograde::sim {

struct RelocationRules : EpisodeRules {
  // Drawn per episode, uniformly between low and high.
  Eigen::Vector3d goal_low_m, goal_high_m;
  std::array<double, 2> goal_rotation_rad;  // of each Euler angle
  Eigen::Vector3d object_low_m, object_high_m;
  // Of each of the object's three shapes.
  Eigen::Vector3d half_size_low_m, half_size_high_m;
  Eigen::Vector3d friction_low, friction_high;  // sliding, torsional, rolling
  std::array<double, 2> mass_kg;                // of the whole object

  double joint_offset;  // of each joint's range, added to where the arm starts

  // Solved: the object is nearer to the goal than position_tolerance_m. Dropped: it is farther from
  // the palm than drop_distance_m.
  double position_tolerance_m;
  double drop_distance_m;

  // Where the official environment does what nobody would expect, each on or off (README.md tells
  // each).
  bool first_observation_of_first_draw;
  bool inertia_fixed;
  bool search_boxes_fixed;
  bool rotation_error_unwrapped;
};

// Strict: every key must be there, none may be unknown, numbers have ranges.
// `where` names the object in errors.
absl::StatusOr<RelocationRules> ParseRelocationRules(const nlohmann::json& rules,
                                                     const std::string& where);

}  // namespace myograde::sim
