// The rules of the elbow's profiles and what a wrong one is told.
#include "sim/elbow/rules.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/base/config_reader.h"
#include "sim/tracks.h"
#include "tests/sim/elbow/helpers.h"
#include "tests/sim/golden.h"

namespace myograde::sim {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;

std::string ElbowMistake(const json& rules) {
  const auto parsed = ParseElbowRules(rules, "rules");
  EXPECT_EQ(parsed.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(parsed.status().message());
}

TEST(ElbowRules, HoldIsTheTaskWithoutTheOfficialDefects) {
  const ElbowRules rules = ElbowRulesOf("hold");
  EXPECT_EQ(rules.end_rule, ElbowRules::EndRule::kHeld);
  EXPECT_EQ(rules.max_steps, 100);
  EXPECT_EQ(rules.target_range_rad, (std::array<double, 2>{0, 2.26893}));
  EXPECT_EQ(rules.tolerance_rad, 0.05);
  EXPECT_EQ(rules.hold_steps, 25);
  EXPECT_FALSE(rules.velocities_times_step);
  EXPECT_FALSE(rules.actions_unclipped);
  EXPECT_FALSE(rules.warnings_reset_simulation);
}

TEST(ElbowRules, MyosuiteIsTheOfficialEnvironment) {
  const ElbowRules rules = ElbowRulesOf("myosuite");
  EXPECT_EQ(rules.end_rule, ElbowRules::EndRule::kTime);
  EXPECT_EQ(rules.max_steps, 100);
  EXPECT_EQ(rules.target_range_rad, (std::array<double, 2>{0, 2.27}));
  EXPECT_EQ(rules.solved_distance_rad, 0.175);
  EXPECT_TRUE(rules.velocities_times_step);
  EXPECT_TRUE(rules.actions_unclipped);
  EXPECT_TRUE(rules.warnings_reset_simulation);
}

TEST(ElbowRules, EveryKeyIsRequiredAndNoOtherIsTaken) {
  const json good = ElbowConfig("hold").rules;
  for (const auto& [key, value] : good.items()) {
    json rules = good;
    rules.erase(key);
    EXPECT_THAT(ElbowMistake(rules), AllOf(HasSubstr(key), HasSubstr("missing")));
  }
  json rules = good;
  rules["tolerance_deg"] = 3;
  EXPECT_THAT(ElbowMistake(rules), HasSubstr("tolerance_deg"));
}

TEST(ElbowRules, ValuesOutOfRangeAreNamed) {
  const std::pair<const char*, json> mistakes[] = {
      {"max_steps", 0},
      {"max_steps", 1.5},
      {"end_rule", "never"},
      {"target_range_rad", {0}},
      {"target_range_rad", {-0.1, 1}},
      {"target_range_rad", {0, 2.6}},
      {"target_range_rad", {2, 1}},
      {"tolerance_rad", 0},
      {"tolerance_rad", 3},
      {"hold_steps", 0},
      {"hold_steps", 101},
      {"solved_distance_rad", -1},
      {"velocities_times_step", 1},
      {"actions_unclipped", "no"},
      {"warnings_reset_simulation", nullptr}};
  for (const auto& [key, value] : mistakes) {
    json rules = ElbowConfig("hold").rules;
    rules[key] = value;
    EXPECT_THAT(ElbowMistake(rules), HasSubstr(key)) << value;
  }
}

TEST(ElbowRules, TheSchemaHasTheirKeysAndRanges) {
  const json schema =
      ReadJsonFile(MYOGRADE_SOURCE_DIR "/configs/schema/track.json").value();
  const json good = ElbowConfig("hold").rules;
  const json& keys = schema.at("$defs").at("elbow_rules").at("properties");
  EXPECT_EQ(keys.size(), good.size());
  for (const auto& [key, said] : keys.items()) {
    ASSERT_TRUE(good.contains(key)) << key;
    const bool list = said.contains("items");
    const json& range = list ? said["items"] : said;
    if (!range.contains("minimum")) continue;
    for (const int beyond : {-1, 1}) {
      json rules = good;
      json& value = list ? rules[key][beyond < 0 ? 0 : 1] : rules[key];
      const json& edge = range[beyond < 0 ? "minimum" : "maximum"];
      value = range["type"] == "integer" ? json(edge.get<int64_t>() + beyond)
                                         : json(edge.get<double>() + 1e-6 * beyond);
      EXPECT_THAT(ElbowMistake(rules), HasSubstr(key)) << value;
    }
  }
}

TEST(ElbowRules, EveryProfileMakesAnEnvironment) {
  for (const char* profile : {"hold", "myosuite"}) {
    const auto environment = MakeEnvironment(ElbowConfig(profile), CacheDir());
    ASSERT_TRUE(environment.ok()) << environment.status();
    EXPECT_EQ((*environment)->observation_size(), 9);
    EXPECT_EQ((*environment)->action_size(), 6);
  }
}

TEST(ElbowRules, AWrongRuleMakesNoEnvironment) {
  TrackConfig config = ElbowConfig("hold");
  config.rules["tolerance_rad"] = 0;
  const auto environment = MakeEnvironment(config, CacheDir());
  EXPECT_EQ(environment.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(environment.status().message()),
              AllOf(HasSubstr("profile hold"), HasSubstr("tolerance_rad")));
}

}  // namespace
}  // namespace myograde::sim
