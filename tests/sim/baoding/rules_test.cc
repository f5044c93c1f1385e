// The rules of Baoding balls and what a wrong one is told.
#include "sim/baoding/rules.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/tracks.h"
#include "tests/sim/baoding/helpers.h"
#include "tests/sim/golden.h"
#include "tests/sim/strict_rules.h"

namespace myograde::sim {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;

std::string Mistake(const json& rules) {
  const auto parsed = ParseBaodingRules(rules, "rules");
  EXPECT_EQ(parsed.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(parsed.status().message());
}

TEST(BaodingRules, OfficialIsTheRegisteredEnvironment) {
  const BaodingRules rules = BallsRules();
  using Range = std::array<double, 2>;
  EXPECT_EQ(rules.max_steps, 200);
  EXPECT_EQ(rules.x_radius_m, (Range{0.020, 0.030}));
  EXPECT_EQ(rules.y_radius_m, (Range{0.022, 0.032}));
  EXPECT_EQ(rules.period_s, (Range{4, 6}));
  EXPECT_EQ(rules.mass_kg, (Range{0.03, 0.3}));
  EXPECT_EQ(rules.friction_change, Eigen::Vector3d(0.2, 0.001, 0.00002));
  EXPECT_EQ(rules.size_m, (Range{0.018, 0.024}));
  EXPECT_EQ(rules.position_tolerance_m, 0.015);
  EXPECT_EQ(rules.drop_height_m, 1.25);
  EXPECT_TRUE(rules.inertia_fixed && rules.bounding_radius_fixed &&
              rules.search_boxes_fixed && rules.targets_late &&
              rules.velocities_times_step && rules.actions_unclipped &&
              rules.warnings_reset_simulation);
}

TEST(BaodingRules, EveryKeyIsRequiredAndNoOtherIsTaken) {
  ExpectEveryKey(BallsConfig().rules, Mistake);
}

TEST(BaodingRules, ValuesOutOfRangeAreNamed) {
  const std::pair<const char*, json> mistakes[] = {
      {"max_steps", 0},
      {"x_radius_m", {0.03, 0.02}},
      {"y_radius_m", {0.2, 0.3}},
      {"period_s", {0, 5}},
      {"mass_kg", {0.2, 0.1}},
      {"friction_change", {0.2, 0.006, 0}},
      {"friction_change", {0.2, 0.001}},
      {"size_m", {0.02}},
      {"drop_height_m", 1.5},
      {"inertia_fixed", 1},
      {"targets_late", nullptr}};
  for (const auto& [key, value] : mistakes) {
    json rules = BallsConfig().rules;
    rules[key] = value;
    EXPECT_THAT(Mistake(rules), HasSubstr(key)) << value;
  }
}

TEST(BaodingRules, TheSchemaHasTheirKeysAndRanges) {
  ExpectSchema(BallsConfig().rules, "baoding_rules", Mistake);
}

TEST(BaodingRules, AWrongRuleMakesNoEnvironment) {
  TrackConfig config = BallsConfig();
  ASSERT_TRUE(MakeEnvironment(config, CacheDir()).ok());
  config.rules["drop_height_m"] = 2;
  const absl::Status status = MakeEnvironment(config, CacheDir()).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()),
              AllOf(HasSubstr("profile official"), HasSubstr("drop_height_m")));
}

}  // namespace
}  // namespace myograde::sim
