// The rules of die reorientation and what a wrong one is told.
#include "sim/reorientation/rules.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/tracks.h"
#include "tests/sim/golden.h"
#include "tests/sim/reorientation/helpers.h"
#include "tests/sim/strict_rules.h"

namespace myograde::sim {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;

std::string Mistake(const json& rules) {
  const auto parsed = ParseReorientationRules(rules, "rules");
  EXPECT_EQ(parsed.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(parsed.status().message());
}

TEST(ReorientationRules, OfficialIsTheRegisteredEnvironment) {
  const ReorientationRules rules = DieRules();
  EXPECT_EQ(rules.max_steps, 150);
  EXPECT_EQ(rules.goal_position_m, (std::array<double, 2>{-0.02, 0.02}));
  EXPECT_EQ(rules.goal_rotation_rad, (std::array<double, 2>{-3.14, 3.14}));
  EXPECT_EQ(rules.friction_change, Eigen::Vector3d(0.2, 0.001, 0.00002));
  EXPECT_EQ(rules.mass_kg, (std::array<double, 2>{0.05, 0.25}));
  EXPECT_EQ(rules.size_change_m, 0.007);
  EXPECT_EQ(rules.position_tolerance_m, 0.025);
  EXPECT_EQ(rules.rotation_tolerance_rad, 0.262);
  EXPECT_EQ(rules.drop_distance_m, 0.2);
  EXPECT_TRUE(rules.inertia_fixed && rules.bounding_radius_fixed && rules.search_boxes_fixed &&
              rules.rotation_error_unwrapped && rules.velocities_times_step &&
              rules.actions_unclipped && rules.warnings_reset_simulation);
}

TEST(ReorientationRules, EveryKeyIsRequiredAndNoOtherIsTaken) {
  ExpectEveryKey(DieConfig().rules, Mistake);
}

TEST(ReorientationRules, ValuesOutOfRangeAreNamed) {
  const std::pair<const char*, json> mistakes[] = {
      {"max_steps", 0},
      {"goal_position_m", {0.02, -0.02}},
      {"goal_rotation_rad", {0}},
      {"friction_change", {0.2, 0.006, 0}},
      {"friction_change", {0.2, 0.001}},
      {"mass_kg", {0.2, 0.1}},
      {"mass_kg", {0, 0.1}},
      {"size_change_m", -0.001},
      {"drop_distance_m", 0},
      {"inertia_fixed", 1},
      {"warnings_reset_simulation", nullptr}};
  for (const auto& [key, value] : mistakes) {
    json rules = DieConfig().rules;
    rules[key] = value;
    EXPECT_THAT(Mistake(rules), HasSubstr(key)) << value;
  }
}

TEST(ReorientationRules, TheSchemaHasTheirKeysAndRanges) {
  ExpectSchema(DieConfig().rules, "reorientation_rules", Mistake);
}

TEST(ReorientationRules, AWrongRuleMakesNoEnvironment) {
  TrackConfig config = DieConfig();
  ASSERT_TRUE(MakeEnvironment(config, CacheDir()).ok());
  config.rules["size_change_m"] = 1;
  const absl::Status status = MakeEnvironment(config, CacheDir()).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()),
              AllOf(HasSubstr("profile official"), HasSubstr("size_change_m")));
}

}  // namespace
}  // namespace myograde::sim
