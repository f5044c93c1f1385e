// The rules objects of the shipped config, and what a wrong one is told.
#include "sim/locomotion/rules.h"

#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/sim/locomotion/fixture.h"

namespace myograde::sim {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

std::string Mistake(const nlohmann::json& rules) {
  return std::string(ParseLocomotionRules(rules, "rules").status().message());
}

// The paper's rules with the value at a JSON pointer replaced.
std::string MistakeWith(const std::string& pointer, const nlohmann::json& value) {
  nlohmann::json rules = ShippedRules("paper");
  rules[nlohmann::json::json_pointer(pointer)] = value;
  return Mistake(rules);
}

TEST(LocomotionRules, ShippedProfilesSayWhatTheyShould) {
  const LocomotionRules paper = ParsedRules(ShippedRules("paper"));
  EXPECT_EQ(paper.field.columns, 30);
  EXPECT_EQ(paper.course.kinds.size(), 5u);
  EXPECT_EQ(paper.end.half_width_m, 1.5);
  EXPECT_EQ(paper.leg.sets, 5);
  EXPECT_TRUE(paper.leg.full_torque);
  EXPECT_TRUE(paper.clip_actions);
  EXPECT_FALSE(paper.warnings_reset_simulation);
  EXPECT_EQ(paper.end.head_reference, HeadReference::kGround);
  EXPECT_EQ(paper.observation.height_map, HeightMapKind::kHeading);
  const LocomotionRules myosuite = ParsedRules(ShippedRules("myosuite"));
  EXPECT_EQ(myosuite.field.columns, 20);
  EXPECT_EQ(myosuite.course.kinds,
            (std::vector{CourseKind::kStairs, CourseKind::kHilly, CourseKind::kRough}));
  EXPECT_EQ(myosuite.course.rough_stream, RoughStream::kLegacy);
  EXPECT_EQ(myosuite.leg.sets, 4);
  EXPECT_FALSE(myosuite.leg.full_torque);
  EXPECT_FALSE(myosuite.clip_actions);
  EXPECT_TRUE(myosuite.warnings_reset_simulation);
  EXPECT_TRUE(myosuite.observation.velocities_times_step);
  EXPECT_TRUE(myosuite.end.lost_reports_time_limit);
}

TEST(LocomotionRules, EveryKeyIsNeededAndNoOtherIsKnown) {
  const nlohmann::json rules = ShippedRules("paper");
  for (const auto& [part, values] : rules.items()) {
    if (part.starts_with("//")) continue;
    nlohmann::json without = rules;
    without.erase(part);
    EXPECT_THAT(Mistake(without), AllOf(HasSubstr("rules"), HasSubstr("\"" + part + "\"")));
    if (!values.is_object()) continue;
    nlohmann::json more = rules;
    more[part]["surprise"] = 1;
    EXPECT_THAT(Mistake(more), AllOf(HasSubstr("rules." + part), HasSubstr("surprise")));
    for (const auto& [key, value] : values.items()) {
      if (key.starts_with("//")) continue;
      without = rules;
      without[part].erase(key);
      EXPECT_THAT(Mistake(without), HasSubstr("rules." + part + ": \"" + key + "\" is missing"));
    }
  }
}

TEST(LocomotionRules, RefusesLimitsThatAreNone) {
  for (const char* pointer :
       {"/end/time_limit_s", "/end/half_width_m", "/end/behind_m", "/end/head_height_m",
        "/leg/sets", "/leg/max_stiffness", "/leg/max_damping", "/pain_clip_nm", "/field/rows",
        "/field/ceiling_m", "/observation/height_map_pitch_m", "/course/patch_m"}) {
    EXPECT_THAT(MistakeWith(pointer, 0), HasSubstr("must be from")) << pointer;
    EXPECT_THAT(MistakeWith(pointer, -3), HasSubstr("must be from")) << pointer;
    EXPECT_THAT(MistakeWith(pointer, nullptr), HasSubstr("must be a")) << pointer;
  }
}

TEST(LocomotionRules, RefusesWhatDoesNotFitTogether) {
  EXPECT_THAT(MistakeWith("/course/kinds", {"flat", "ice"}), HasSubstr("has \"ice\""));
  EXPECT_THAT(MistakeWith("/course/kinds", {"flat", "flat"}), HasSubstr("\"flat\" twice"));
  EXPECT_THAT(MistakeWith("/course/kinds", nlohmann::json::array()), HasSubstr("at least one"));
  EXPECT_THAT(MistakeWith("/course/mixed_kinds", {"mixed"}), HasSubstr("must have only"));
  EXPECT_THAT(MistakeWith("/course/difficulty", nlohmann::json::array()),
              HasSubstr("an entry for each patch"));
  EXPECT_THAT(MistakeWith("/course/step_m", 0.8), HasSubstr("field.ceiling_m is only 2"));
  EXPECT_THAT(MistakeWith("/course/hill_length_m", 6), HasSubstr("larger than patch_m"));
  EXPECT_THAT(MistakeWith("/start/x_m", {0.8, -0.8}), HasSubstr("low <= high"));
  EXPECT_THAT(MistakeWith("/start/x_m", {-2, 0}), HasSubstr("x_m"));
  EXPECT_THAT(MistakeWith("/end/finish_y_m", 56), HasSubstr("towards smaller y"));
  EXPECT_THAT(MistakeWith("/end/distance_from_y_m", -50), HasSubstr("above finish_y_m"));
  EXPECT_THAT(MistakeWith("/field/columns", 31), HasSubstr("must be from 2 to 30"));
  nlohmann::json rows = ShippedRules("myosuite");
  rows["course"]["patch_rows"] = 30;
  EXPECT_THAT(Mistake(rows), HasSubstr("the field has only 600 rows"));
}

TEST(LocomotionRules, AHandMustBeThereToDeal) {
  EXPECT_THAT(MistakeWith("/course/mixed_at_least", 3),
              HasSubstr("makes a hand of 9, the course has only 8 obstacles"));
  EXPECT_THAT(MistakeWith("/course/mixed_at_least", -1), HasSubstr("must be from 0"));
  EXPECT_THAT(MistakeWith("/course/draw_level_patches", true),
              HasSubstr("must be 0 where level patches are drawn"));
}

TEST(LocomotionRules, ParameterSetsAreToldWithTheirPlace) {
  const std::string first = "/leg/parameter_sets/1/l_stance";
  const std::string place = "rules.leg.parameter_sets[1].l_stance";
  EXPECT_THAT(MistakeWith("/leg/sets", 4),
              HasSubstr("has 5 entries, must have one for each of the 4"));
  EXPECT_THAT(MistakeWith("/leg/parameter_sets", 3), HasSubstr("must be an array"));
  EXPECT_THAT(MistakeWith("/leg/parameter_sets/2", 3), HasSubstr("parameter_sets[2]"));
  EXPECT_THAT(MistakeWith(first, 3), HasSubstr("rules.leg.parameter_sets[1]: \"l_stance\""));
  EXPECT_THAT(MistakeWith(first + "/knee/stiffness", 2001),
              AllOf(HasSubstr(place + ".knee"), HasSubstr("from 0 to 2000")));
  EXPECT_THAT(MistakeWith(first + "/ankle/damping", -1), HasSubstr("from 0 to 200"));
  EXPECT_THAT(MistakeWith(first + "/knee/target_deg", 121), HasSubstr("from 0 to 120"));
  EXPECT_THAT(MistakeWith(first + "/ankle/target_deg", -31), HasSubstr("from -30 to 30"));
  EXPECT_THAT(MistakeWith(first + "/knee/stifness", 1), HasSubstr("not a known key"));
  EXPECT_THAT(MistakeWith(first + "/until", nlohmann::json::object()),
              HasSubstr("to leave the state"));
  EXPECT_THAT(MistakeWith(first + "/until", {{"load_above", 1}, {"load_below", 2}}),
              HasSubstr("can't both be there"));
  EXPECT_THAT(MistakeWith(first + "/until", {{"hip_deg_above", 1}, {"load_above", 1}}),
              HasSubstr("hip_deg_above"));
}

TEST(LocomotionRules, TheModelMustHaveRoomForTheField) {
  LocomotionRules rules = ParsedRules(ShippedRules("paper"));
  rules.field.columns = 31;
  EXPECT_THROW(MakeEnvironment(rules), std::runtime_error);
}

}  // namespace
}  // namespace myograde::sim
