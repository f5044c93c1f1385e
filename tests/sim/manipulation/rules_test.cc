// The rules of the three profiles and what a wrong one is told.
#include "sim/manipulation/rules.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/lease/track_config.h"
#include "sim/tracks.h"
#include "tests/sim/golden.h"
#include "tests/sim/manipulation/helpers.h"

namespace myograde {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;

TrackConfig Config(const std::string& profile) {
  auto config =
      LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "manipulation", profile);
  EXPECT_TRUE(config.ok()) << config.status();
  return *config;
}

std::string MistakeOf(const json& rules) {
  const auto parsed = ParseManipulationRules(rules, "rules");
  EXPECT_EQ(parsed.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(parsed.status().message());
}

TEST(ManipulationRules, PaperIsWhatTheChallengePublished) {
  const ManipulationRules rules = sim::RulesOf("paper");
  EXPECT_EQ(rules.end_rule, ManipulationRules::EndRule::kPlaced);
  EXPECT_EQ(rules.object_point, ManipulationRules::ObjectPoint::kBoxCentre);
  EXPECT_EQ(rules.inertia, ManipulationRules::Inertia::kSolidBox);
  EXPECT_EQ(rules.world_contact, ManipulationRules::CountsAs::kOther);
  EXPECT_EQ(rules.torso_contact, ManipulationRules::CountsAs::kOther);
  EXPECT_EQ(rules.mass_kg, 0.097);
  EXPECT_EQ(rules.mass_spread_kg, 0.05);
  EXPECT_EQ(rules.size_spread, Eigen::Vector3d(0.05, 0.1, 0.05));
  EXPECT_EQ(rules.hold_frames, 8);
  EXPECT_EQ(rules.placed_axis_m, 0.1);
  EXPECT_EQ(rules.drop_height_m, 0.3);
  for (const bool defect :
       {rules.one_environment, rules.peak_touch_survives_reset, rules.size_fixed_on_first_reset,
        rules.bounding_radius_fixed, rules.stale_first_observation, rules.end_lags_solved,
        rules.actions_unclipped, rules.warnings_reset_simulation, rules.phantom_trials}) {
    EXPECT_FALSE(defect);
  }
}

TEST(ManipulationRules, OfficialProfilesKeepTheDefects) {
  for (const char* profile : {"myosuite", "as-graded"}) {
    const ManipulationRules rules = sim::RulesOf(profile);
    EXPECT_EQ(rules.end_rule, ManipulationRules::EndRule::kSolved);
    EXPECT_EQ(rules.solved_distance_m, 0.17);
    EXPECT_EQ(rules.solved_goal_frames, 10);
    EXPECT_EQ(rules.mass_kg, 0.27006089218076124);
    EXPECT_EQ(rules.size_spread, Eigen::Vector3d(0.1, 0.05, 0.1));
    for (const bool defect :
         {rules.peak_touch_survives_reset, rules.size_fixed_on_first_reset,
          rules.bounding_radius_fixed, rules.stale_first_observation, rules.end_lags_solved,
          rules.actions_unclipped, rules.warnings_reset_simulation, rules.phantom_trials}) {
      EXPECT_TRUE(defect) << profile;
    }
    EXPECT_EQ(rules.one_environment, std::string(profile) == "as-graded");
  }
}

TEST(ManipulationRules, EveryKeyIsRequiredAndNoOtherIsTaken) {
  const json good = Config("paper").rules;
  for (const auto& [key, value] : good.items()) {
    if (key.starts_with("//")) continue;
    json rules = good;
    rules.erase(key);
    EXPECT_THAT(MistakeOf(rules), AllOf(HasSubstr(key), HasSubstr("missing")));
  }
  json rules = good;
  rules["drop_hight_m"] = 0.3;
  EXPECT_THAT(MistakeOf(rules), HasSubstr("drop_hight_m"));
}

TEST(ManipulationRules, ValuesOutOfRangeAreNamed) {
  const std::pair<const char*, json> mistakes[] = {
      {"max_steps", 0},           {"max_steps", -3},
      {"max_time_s", 0},          {"hold_frames", 0},
      {"solved_goal_frames", 0},  {"placed_axis_m", -0.1},
      {"mass_kg", 0},             {"mass_spread_kg", 0.1},
      {"half_size_m", {0.1, 0.1}}, {"half_size_m", {0.1, 0.1, 0}},
      {"size_spread", {1, 0, 0}}, {"friction_spread", {2, 0, 0}},
      {"end_rule", "never"},      {"world_contact", "floor"},
      {"torso_contact", "body"},
      {"phantom_trials", 1},      {"drop_height_m", "low"}};
  for (const auto& [key, value] : mistakes) {
    json rules = Config("paper").rules;
    rules[key] = value;
    EXPECT_THAT(MistakeOf(rules), HasSubstr(key)) << value;
  }
}

TEST(ManipulationRules, OneEnvironmentNeedsOneLease) {
  TrackConfig config = Config("as-graded");
  config.episodes_per_lease = static_cast<int64_t>(config.seeds.size()) - 1;
  const auto environment = sim::MakeEnvironment(config, sim::CacheDir());
  EXPECT_EQ(environment.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(environment.status().message()), HasSubstr("episodes_per_lease"));
}

TEST(ManipulationRules, EveryProfileMakesAnEnvironment) {
  for (const char* profile : {"paper", "myosuite", "as-graded"}) {
    const auto environment = sim::MakeEnvironment(Config(profile), sim::CacheDir());
    ASSERT_TRUE(environment.ok()) << environment.status();
    EXPECT_EQ((*environment)->observation_size(), 222);
    EXPECT_EQ((*environment)->action_size(), 80);
  }
}

}  // namespace
}  // namespace myograde
