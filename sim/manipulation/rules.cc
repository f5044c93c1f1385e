#include "sim/manipulation/rules.h"

#include "protocol/base/config_reader.h"

namespace myograde {
namespace {

using Rules = ManipulationRules;

// Longer than any place in the scene, lighter and heavier than any object.
constexpr NumberRange kPosition = {-10, 10};
constexpr NumberRange kLength = {1e-3, 10};
constexpr NumberRange kSpread = {0, 10};
constexpr NumberRange kMass = {1e-3, 100};
constexpr NumberRange kFriction = {0, 10};
constexpr NumberRange kFraction = {0, 0.9};

Eigen::Vector3d ReadVector(ConfigReader& reader, std::string_view key, NumberRange range) {
  return Eigen::Vector3d::Map(reader.Numbers(key, 3, range).data());
}

Rules::CountsAs ReadCountsAs(ConfigReader& reader, std::string_view key) {
  return reader.Choice(key, {"other", "arm"}) == "other" ? Rules::CountsAs::kOther
                                                         : Rules::CountsAs::kArm;
}

void ReadEnd(ConfigReader& reader, Rules& rules) {
  rules.max_steps = reader.Integer("max_steps", 1, 1'000'000);
  rules.max_time_s = reader.Number("max_time_s", {0.01, 10'000});
  rules.drop_height_m = reader.Number("drop_height_m", kPosition);
  rules.end_rule = reader.Choice("end_rule", {"placed", "solved"}) == "placed"
                       ? Rules::EndRule::kPlaced
                       : Rules::EndRule::kSolved;
  rules.object_point = reader.Choice("object_point", {"box_centre", "touch_site"}) == "box_centre"
                           ? Rules::ObjectPoint::kBoxCentre
                           : Rules::ObjectPoint::kTouchSite;
}

void ReadVariation(ConfigReader& reader, Rules& rules) {
  rules.start_centre_m = ReadVector(reader, "start_centre_m", kPosition);
  rules.start_spread_m = ReadVector(reader, "start_spread_m", kSpread);
  rules.goal_centre_m = ReadVector(reader, "goal_centre_m", kPosition);
  rules.goal_spread_m = ReadVector(reader, "goal_spread_m", kSpread);
  rules.release_height_m = reader.Number("release_height_m", kSpread);
  rules.mass_kg = reader.Number("mass_kg", kMass);
  rules.mass_spread_kg = reader.Number("mass_spread_kg", kSpread);
  if (rules.mass_spread_kg >= rules.mass_kg) {
    reader.Fail("mass_spread_kg", "must be below mass_kg, or a mass could be drawn below zero");
  }
  rules.friction = ReadVector(reader, "friction", kFriction);
  rules.friction_spread = ReadVector(reader, "friction_spread", kFriction);
  if ((rules.friction_spread.array() > rules.friction.array()).any()) {
    reader.Fail("friction_spread", "must not be above friction on any axis");
  }
  rules.half_size_m = ReadVector(reader, "half_size_m", kLength);
  rules.size_spread = ReadVector(reader, "size_spread", kFraction);
  rules.inertia = reader.Choice("inertia", {"solid_box", "model"}) == "solid_box"
                      ? Rules::Inertia::kSolidBox
                      : Rules::Inertia::kModel;
}

void ReadPlacement(ConfigReader& reader, Rules& rules) {
  rules.goal_face_m = reader.Number("goal_face_m", kPosition);
  rules.placed_axis_m = reader.Number("placed_axis_m", kLength);
  rules.hold_frames = reader.Integer("hold_frames", 1, 100'000);
  rules.solved_distance_m = reader.Number("solved_distance_m", kLength);
  rules.solved_goal_frames = reader.Integer("solved_goal_frames", 1, 100'000);
  rules.world_contact = ReadCountsAs(reader, "world_contact");
  rules.torso_contact = ReadCountsAs(reader, "torso_contact");
  rules.count_reset_frame = reader.Boolean("count_reset_frame");
}

void ReadSwitches(ConfigReader& reader, Rules& rules) {
  rules.one_environment = reader.Boolean("one_environment");
  rules.peak_touch_survives_reset = reader.Boolean("peak_touch_survives_reset");
  rules.size_fixed_on_first_reset = reader.Boolean("size_fixed_on_first_reset");
  rules.bounding_radius_fixed = reader.Boolean("bounding_radius_fixed");
  rules.stale_first_observation = reader.Boolean("stale_first_observation");
  rules.end_lags_solved = reader.Boolean("end_lags_solved");
  rules.actions_unclipped = reader.Boolean("actions_unclipped");
  rules.warnings_reset_simulation = reader.Boolean("warnings_reset_simulation");
  rules.phantom_trials = reader.Boolean("phantom_trials");
}

}  // namespace

absl::StatusOr<ManipulationRules> ParseManipulationRules(const nlohmann::json& json,
                                                         const std::string& where) {
  ConfigReader reader(json, where);
  ManipulationRules rules = {};
  ReadEnd(reader, rules);
  ReadVariation(reader, rules);
  ReadPlacement(reader, rules);
  ReadSwitches(reader, rules);
  if (auto status = reader.Finish(); !status.ok()) return status;
  return rules;
}

}  // namespace myograde
