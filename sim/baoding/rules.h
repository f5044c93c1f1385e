// The numbers and switches of Baoding balls: the "rules" object of a profile in configs/tracks/.
// One implementation reads them all; a profile is nothing but a set of values. Lengths in m; a step
// is a control step of 0.025 s.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include <Eigen/Core>
#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "sim/model/episode_rules.h"

namespace myograde::sim {

struct BaodingRules : EpisodeRules {
  // Drawn per episode, uniformly from [low, high] or within nominal +- change.
  std::array<double, 2> x_radius_m;  // of the targets' ellipse in the palm's frame
  std::array<double, 2> y_radius_m;
  std::array<double, 2> period_s;   // of a turn
  std::array<double, 2> mass_kg;    // of each ball
  Eigen::Vector3d friction_change;  // of each ball: sliding, torsional, rolling
  std::array<double, 2> size_m;     // of each ball: its radius

  // Solved: both balls are nearer to their targets than the tolerance. Dropped: a ball is lower
  // in the world than drop_height_m.
  double position_tolerance_m;
  double drop_height_m;

  // Where the official environment does what nobody would expect, each on or off (README.md tells
  // each).
  bool inertia_fixed;
  bool bounding_radius_fixed;
  bool search_boxes_fixed;
  bool targets_late;
};

// Strict: every key must be there, none may be unknown, numbers have ranges.
// `where` names the object in errors.
absl::StatusOr<BaodingRules> ParseBaodingRules(const nlohmann::json& rules,
                                               const std::string& where);

}  // namespace myograde::sim
