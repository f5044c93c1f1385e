// The numbers and switches of die reorientation: the "rules" object of a profile in
// configs/tracks/. One implementation reads them all; a profile is nothing but a set of values.
// Lengths in m, angles in rad; a step is a control step of 0.01 s.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include <Eigen/Core>
#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "sim/model/episode_rules.h"

namespace myograde::sim {

struct ReorientationRules : EpisodeRules {
  // Drawn per episode, uniformly from [low, high] or within nominal +- change.
  std::array<double, 2> goal_position_m;    // on each axis, from the goal's place in the model
  std::array<double, 2> goal_rotation_rad;  // of each Euler angle
  Eigen::Vector3d friction_change;          // sliding, torsional, rolling
  std::array<double, 2> mass_kg;
  double size_change_m;                     // of half an edge

  // Solved: both errors are below these. Dropped: the position's is above drop_distance_m.
  double position_tolerance_m;
  double rotation_tolerance_rad;
  double drop_distance_m;

  // Where the official environment does what nobody would expect, each on or off (README.md tells
  // each).
  bool inertia_fixed;
  bool bounding_radius_fixed;
  bool search_boxes_fixed;
  bool rotation_error_unwrapped;
};

// Strict: every key must be there, none may be unknown, numbers have ranges.
// `where` names the object in errors.
absl::StatusOr<ReorientationRules> ParseReorientationRules(const nlohmann::json& rules,
                                                           const std::string& where);

}  // namespace myograde::sim
