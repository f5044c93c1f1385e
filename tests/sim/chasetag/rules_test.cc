// The rules of chase-tag and what a wrong one is told.
#include "sim/chasetag/rules.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/tracks.h"
#include "tests/sim/chasetag/helpers.h"
#include "tests/sim/golden.h"
#include "tests/sim/strict_rules.h"

namespace myograde::sim {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;
using Range = std::array<double, 2>;

std::string Mistake(const json& rules) {
  const auto parsed = ParseChaseTagRules(rules, "rules");
  EXPECT_EQ(parsed.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(parsed.status().message());
}

TEST(ChaseTagRules, OfficialIsTheRegisteredEnvironment) {
  const ChaseTagRules rules = ChaseRules();
  EXPECT_EQ(rules.max_steps, 2000);
  EXPECT_EQ(rules.time_limit_s, 20);
  EXPECT_EQ(rules.tag_distance_m, 0.5);
  EXPECT_EQ(rules.bounds_m, 6.5);
  EXPECT_EQ(rules.fall_height_m, 0.2);
  EXPECT_EQ(rules.start_m, 5);
  EXPECT_EQ(rules.start_noise, 0.02);
  EXPECT_EQ(rules.spawn_distance_m, 2);
  EXPECT_EQ(rules.opponent_shares, (std::array<double, 4>{0.1, 0.35, 0.35, 0.2}));
  EXPECT_EQ(rules.chase_speed, (Range{1, 5}));
  EXPECT_EQ(rules.random_speed, (Range{-2, 2}));
  EXPECT_EQ(rules.repelled_speed, (Range{0.3, 1}));
  EXPECT_EQ(rules.hills_m, (Range{0.03, 0.23}));
  EXPECT_EQ(rules.roughness_m, (Range{0.05, 0.1}));
  EXPECT_EQ(rules.relief_m, (Range{0.1, 0.3}));
  EXPECT_EQ(rules.relief_share, 0.2);
  EXPECT_TRUE(rules.orientation_with_noise && rules.first_observation_before_opponent &&
              rules.start_patch_mirrored && rules.opponent_speed_unclipped &&
              rules.velocities_times_step && rules.actions_unclipped &&
              rules.warnings_reset_simulation);
}

TEST(ChaseTagRules, EveryKeyIsRequiredAndNoOtherIsTaken) {
  ExpectEveryKey(ChaseConfig().rules, Mistake);
}

TEST(ChaseTagRules, ValuesOutOfRangeAreNamed) {
  const std::pair<const char*, json> mistakes[] = {{"max_steps", 0},
                                                   {"time_limit_s", 0},
                                                   {"tag_distance_m", 0},
                                                   {"bounds_m", 0.5},
                                                   {"start_m", 6},
                                                   {"start_noise", -0.1},
                                                   {"spawn_distance_m", 6},
                                                   {"opponent_shares", {0.5, 0.5, 0.5, 0}},
                                                   {"opponent_shares", {1}},
                                                   {"chase_speed", {5, 1}},
                                                   {"random_speed", {-2}},
                                                   {"repelled_speed", {-1, 1}},
                                                   {"hills_m", {0.2, 0.1}},
                                                   {"relief_share", 1.1},
                                                   {"start_patch_mirrored", 1},
                                                   {"actions_unclipped", nullptr}};
  for (const auto& [key, value] : mistakes) {
    json rules = ChaseConfig().rules;
    rules[key] = value;
    EXPECT_THAT(Mistake(rules), HasSubstr(key)) << value;
  }
}

TEST(ChaseTagRules, TheSchemaHasTheirKeysAndRanges) {
  ExpectSchema(ChaseConfig().rules, "chasetag_rules", Mistake);
}

TEST(ChaseTagRules, AWrongRuleMakesNoEnvironment) {
  TrackConfig config = ChaseConfig();
  ASSERT_TRUE(MakeEnvironment(config, CacheDir()).ok());
  config.rules["bounds_m"] = 0;
  const absl::Status status = MakeEnvironment(config, CacheDir()).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()),
              AllOf(HasSubstr("profile official"), HasSubstr("bounds_m")));
}

}  // namespace
}  // namespace myograde::sim
