#include "sim/baoding/rules.h"

#include "protocol/base/config_reader.h"

namespace myograde::sim {

absl::StatusOr<BaodingRules> ParseBaodingRules(const nlohmann::json& json,
                                               const std::string& where) {
  constexpr NumberRange kRadius = {0, 0.1};
  ConfigReader reader(json, where);
  BaodingRules rules = {};
  ReadEpisodeRules(reader, rules);
  rules.x_radius_m = reader.Range("x_radius_m", kRadius);
  rules.y_radius_m = reader.Range("y_radius_m", kRadius);
  rules.period_s = reader.Range("period_s", {0.1, 1000});
  rules.mass_kg = reader.Range("mass_kg", {1e-3, 10});
  rules.friction_change = Eigen::Vector3d::Map(reader.Numbers("friction_change", 3, {0, 1}).data());
  if ((rules.friction_change.array() > Eigen::Array3d(1, 0.005, 0.0001)).any()) {
    reader.Fail("friction_change", "must not be above the nominal friction, [1, 0.005, 0.0001]");
  }
  rules.size_m = reader.Range("size_m", {1e-3, 0.1});
  rules.position_tolerance_m = reader.Number("position_tolerance_m", {1e-4, 10});
  rules.drop_height_m = reader.Number("drop_height_m", {0, 1.4});  // the palm is above
  rules.inertia_fixed = reader.Boolean("inertia_fixed");
  rules.bounding_radius_fixed = reader.Boolean("bounding_radius_fixed");
  rules.search_boxes_fixed = reader.Boolean("search_boxes_fixed");
  rules.targets_late = reader.Boolean("targets_late");
  if (auto status = reader.Finish(); !status.ok()) return status;
  return rules;
}

}  // namespace myograde::sim
