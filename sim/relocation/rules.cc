#include "sim/relocation/rules.h"

#include <vector>

#include "protocol/base/config_reader.h"

namespace myograde::sim {

absl::StatusOr<RelocationRules> ParseRelocationRules(const nlohmann::json& json,
                                                     const std::string& where) {
  constexpr NumberRange kPlace = {-3, 3};
  constexpr NumberRange kHalfSize = {1e-3, 0.1};
  constexpr NumberRange kFriction = {0, 10};
  constexpr NumberRange kDistance = {1e-4, 10};
  ConfigReader reader(json, where);
  const auto vector = [&](std::string_view key, NumberRange allowed) -> Eigen::Vector3d {
    return Eigen::Vector3d::Map(reader.Numbers(key, 3, allowed).data());
  };
  const auto above = [&](std::string_view key, NumberRange allowed, const Eigen::Vector3d& low) {
    const Eigen::Vector3d high = vector(key, allowed);
    if ((high.array() < low.array()).any()) reader.Fail(key, "must not be below its low end");
    return high;
  };
  RelocationRules rules = {};
  ReadEpisodeRules(reader, rules);
  rules.goal_low_m = vector("goal_low_m", kPlace);
  rules.goal_high_m = above("goal_high_m", kPlace, rules.goal_low_m);
  rules.goal_rotation_rad = reader.Range("goal_rotation_rad", {-3.15, 3.15});
  rules.object_low_m = vector("object_low_m", kPlace);
  rules.object_high_m = above("object_high_m", kPlace, rules.object_low_m);
  rules.half_size_low_m = vector("half_size_low_m", kHalfSize);
  rules.half_size_high_m = above("half_size_high_m", kHalfSize, rules.half_size_low_m);
  rules.friction_low = vector("friction_low", kFriction);
  rules.friction_high = above("friction_high", kFriction, rules.friction_low);
  rules.mass_kg = reader.Range("mass_kg", {1e-3, 10});
  rules.joint_offset = reader.Number("joint_offset", {-0.1, 0.1});
  rules.position_tolerance_m = reader.Number("position_tolerance_m", kDistance);
  rules.drop_distance_m = reader.Number("drop_distance_m", kDistance);
  rules.first_observation_of_first_draw = reader.Boolean("first_observation_of_first_draw");
  rules.inertia_fixed = reader.Boolean("inertia_fixed");
  rules.search_boxes_fixed = reader.Boolean("search_boxes_fixed");
  rules.rotation_error_unwrapped = reader.Boolean("rotation_error_unwrapped");
  if (auto status = reader.Finish(); !status.ok()) return status;
  return rules;
}

}  // namespace myograde::sim
