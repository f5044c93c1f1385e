// The rules of relocation and what a wrong one is told.
#include "sim/relocation/rules.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/tracks.h"
#include "tests/sim/golden.h"
#include "tests/sim/relocation/helpers.h"
#include "tests/sim/strict_rules.h"

namespace myograde::sim {
namespace {

using Eigen::Vector3d;
using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;

std::string Mistake(const json& rules) {
  const auto parsed = ParseRelocationRules(rules, "rules");
  EXPECT_EQ(parsed.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(parsed.status().message());
}

TEST(RelocationRules, OfficialIsTheRegisteredEnvironment) {
  const RelocationRules rules = ObjectRules();
  EXPECT_EQ(rules.max_steps, 150);
  EXPECT_EQ(rules.goal_low_m, Vector3d(-0.5, -0.5, 0.9));
  EXPECT_EQ(rules.goal_high_m, Vector3d(0.4, -0.1, 1.1));
  EXPECT_EQ(rules.goal_rotation_rad, (std::array<double, 2>{-0.3, 0.3}));
  EXPECT_EQ(rules.object_low_m, Vector3d(-0.2, -0.4, 1));
  EXPECT_EQ(rules.object_high_m, Vector3d(0.15, -0.1, 1));
  EXPECT_EQ(rules.half_size_low_m, Vector3d(0.015, 0.015, 0.015));
  EXPECT_EQ(rules.half_size_high_m, Vector3d(0.025, 0.025, 0.035));
  EXPECT_EQ(rules.friction_low, Vector3d(0.8, 0.004, 0.00008));
  EXPECT_EQ(rules.friction_high, Vector3d(1.2, 0.006, 0.00012));
  EXPECT_EQ(rules.mass_kg, (std::array<double, 2>{0.05, 0.3}));
  EXPECT_EQ(rules.joint_offset, 0.015);
  EXPECT_EQ(rules.position_tolerance_m, 0.1);
  EXPECT_EQ(rules.drop_distance_m, 0.5);
  EXPECT_TRUE(rules.first_observation_of_first_draw && rules.inertia_fixed &&
              rules.search_boxes_fixed && rules.rotation_error_unwrapped &&
              rules.velocities_times_step && rules.actions_unclipped &&
              rules.warnings_reset_simulation);
}

TEST(RelocationRules, EveryKeyIsRequiredAndNoOtherIsTaken) {
  ExpectEveryKey(ObjectConfig().rules, Mistake);
}

TEST(RelocationRules, ValuesOutOfRangeAreNamed) {
  const std::pair<const char*, json> mistakes[] = {{"max_steps", 0},
                                                   {"goal_high_m", {-0.6, 0, 1}},
                                                   {"goal_rotation_rad", {0}},
                                                   {"object_high_m", {0.15, -0.1, 0.9}},
                                                   {"half_size_high_m", {0.01, 0.015, 0.015}},
                                                   {"friction_low", {0.8, 0.004}},
                                                   {"mass_kg", {0.2, 0.1}},
                                                   {"mass_kg", {0, 0.1}},
                                                   {"joint_offset", 0.2},
                                                   {"drop_distance_m", 0},
                                                   {"inertia_fixed", 1},
                                                   {"warnings_reset_simulation", nullptr}};
  for (const auto& [key, value] : mistakes) {
    json rules = ObjectConfig().rules;
    rules[key] = value;
    EXPECT_THAT(Mistake(rules), HasSubstr(key)) << value;
  }
}

TEST(RelocationRules, TheSchemaHasTheirKeysAndRanges) {
  ExpectSchema(ObjectConfig().rules, "relocation_rules", Mistake);
}

TEST(RelocationRules, AWrongRuleMakesNoEnvironment) {
  TrackConfig config = ObjectConfig();
  ASSERT_TRUE(MakeEnvironment(config, CacheDir()).ok());
  config.rules["joint_offset"] = 1;
  const absl::Status status = MakeEnvironment(config, CacheDir()).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()),
              AllOf(HasSubstr("profile official"), HasSubstr("joint_offset")));
}

}  // namespace
}  // namespace myograde::sim
