#include "sim/reorientation/rules.h"

#include "protocol/base/config_reader.h"

namespace myograde::sim {

absl::StatusOr<ReorientationRules> ParseReorientationRules(const nlohmann::json& json,
                                                           const std::string& where) {
  constexpr NumberRange kTolerance = {1e-4, 10};
  ConfigReader reader(json, where);
  ReorientationRules rules = {};
  ReadEpisodeRules(reader, rules);
  rules.goal_position_m = reader.Range("goal_position_m", {-1, 1});
  rules.goal_rotation_rad = reader.Range("goal_rotation_rad", {-3.15, 3.15});
  rules.friction_change = Eigen::Vector3d::Map(reader.Numbers("friction_change", 3, {0, 1}).data());
  if ((rules.friction_change.array() > Eigen::Array3d(1, 0.005, 0.0001)).any()) {
    reader.Fail("friction_change", "must not be above the nominal friction, [1, 0.005, 0.0001]");
  }
  rules.mass_kg = reader.Range("mass_kg", {1e-3, 10});
  rules.size_change_m = reader.Number("size_change_m", {0, 0.02});  // half a plate is 23.6 mm
  rules.position_tolerance_m = reader.Number("position_tolerance_m", kTolerance);
  rules.rotation_tolerance_rad = reader.Number("rotation_tolerance_rad", kTolerance);
  rules.drop_distance_m = reader.Number("drop_distance_m", kTolerance);
  rules.inertia_fixed = reader.Boolean("inertia_fixed");
  rules.bounding_radius_fixed = reader.Boolean("bounding_radius_fixed");
  rules.search_boxes_fixed = reader.Boolean("search_boxes_fixed");
  rules.rotation_error_unwrapped = reader.Boolean("rotation_error_unwrapped");
  if (auto status = reader.Finish(); !status.ok()) return status;
  return rules;
}

}  // namespace myograde::sim
