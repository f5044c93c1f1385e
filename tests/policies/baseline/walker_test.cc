// What the walker does on the graded course.
#include "policies/baseline/walker.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "policies/baseline/parameter_file.h"
#include "protocol/bridge/leg_sets_json.h"
#include "tests/policies/baseline/walking.h"
#include "tests/sim/locomotion/fixture.h"

namespace myograde::baseline {
namespace {

using ::testing::AllOf;
using ::testing::DoubleNear;
using ::testing::Each;
using ::testing::Ge;
using ::testing::Le;
using ::testing::Not;
using ::testing::Pointwise;

constexpr uint64_t kSeed = 7'000'000'000;  // neither graded nor of the search
constexpr size_t kVelocities = 19, kJointVelocities = 17, kHeights = 265;  // in the observation

std::vector<double> Act(Walker& walker, const std::array<double, kWalkerObservation>& observation) {
  std::vector<double> action(kWalkerAction);
  walker.Act(observation, std::span<double, kWalkerAction>(action));
  return action;
}

LegParameterSets SetsOf(const Walker& walker) {
  LegParameterSets sets{};
  const auto modes = walker.LegModes();
  for (size_t i = 0; i < modes.size(); ++i) {
    sets.present |= 1u << i;
    for (LegStateParameters& state : sets.set[i]) {
      state.knee_stiffness = modes[i].knee_stiffness;
      state.knee_damping = modes[i].knee_damping;
      state.knee_target = modes[i].knee_target;
      state.ankle_stiffness = modes[i].ankle_stiffness;
      state.ankle_damping = modes[i].ankle_damping;
      state.ankle_target = modes[i].ankle_target;
      state.threshold_kind[0] = static_cast<uint8_t>(ThresholdKind::kBelow);
      state.threshold[0] = -1e9;
    }
  }
  return sets;
}

}  // namespace

Walker ShippedWalker(const std::string& profile) {
  Walker walker(ReadWalkerNumbers(std::string(MYOGRADE_SOURCE_DIR) +
                                  "/policies/baseline/parameters/locomotion.json"));
  walker.Expect(ObservedIn(profile));
  return walker;
}

std::unique_ptr<sim::LocomotionEnvironment> CourseOf(const nlohmann::json& rules) {
  auto course = sim::MakeEnvironment(sim::ParsedRules(rules));
  course->SetConvention(ActionConvention::kDirect);
  return course;
}

std::unique_ptr<sim::LocomotionEnvironment> PaperCourse() { return CourseOf(sim::ShippedRules("paper")); }

std::vector<double> Walk(sim::LocomotionEnvironment& course, Walker& walker, uint64_t seed, int steps) {
  course.Reset(seed);
  EXPECT_TRUE(course.SetParameters(LegSetsToJson(SetsOf(walker))).ok());
  walker.Reset();
  std::array<double, kWalkerObservation> observation;
  std::array<double, kWalkerAction> action;
  std::vector<double> actions;
  for (int i = 0; i < steps; ++i) {
    course.Observe(observation);
    walker.Act(observation, action);
    actions.insert(actions.end(), action.begin(), action.end());
    if (course.Step(action).ended) break;
  }
  return actions;
}

namespace {

TEST(Walker, ActsWithinTheBoundsAndTheSameEachTime) {
  Walker walker = ShippedWalker();
  const auto course = PaperCourse();
  const std::vector<double> actions = Walk(*course, walker, kSeed, 150);
  for (size_t i = 0; i < actions.size(); i += kWalkerAction) {
    const std::span<const double> action(actions.data() + i, kWalkerAction);
    EXPECT_THAT(action.first(kMuscles), Each(AllOf(Ge(0), Le(1))));
    EXPECT_THAT(action.back(), AllOf(Ge(0), Le(kLegModes - 1)));
    EXPECT_EQ(action.back(), std::round(action.back()));
  }
  Walk(*course, walker, kSeed + 1, 20);
  EXPECT_EQ(Walk(*course, walker, kSeed, 150), actions);
}

// In official units the same body is observed on the same level ground.
TEST(Walker, ReadsOfficialObservationsAsThoseOfThePaper) {
  nlohmann::json rules = sim::ShippedRules("paper");
  rules["observation"] = sim::ShippedRules("myosuite")["observation"];
  Walker walker = ShippedWalker();
  const auto official = CourseOf(rules);
  const std::vector<double> expected = Walk(*PaperCourse(), walker, kSeed, 100);
  walker.Expect(Observed::kOfficial);
  EXPECT_THAT(Walk(*official, walker, kSeed, 100), Pointwise(DoubleNear(1e-6), expected));
}

TEST(Walker, SeesTheGroundRiseInBothHeightMaps) {
  Walker level = ShippedWalker();
  const auto course = PaperCourse();
  Walk(*course, level, kSeed, 60);
  Walker paper = level, official = level;
  official.Expect(Observed::kOfficial);
  std::array<double, kWalkerObservation> observation;
  course->Observe(observation);
  const std::vector<double> on_level_ground = Act(level, observation);

  constexpr double kRise = 0.1;  // m, half a metre before the body
  std::fill_n(observation.begin() + kHeights + 20, 20, kRise);
  const std::vector<double> before_a_rise = Act(paper, observation);
  EXPECT_THAT(before_a_rise, Not(Pointwise(DoubleNear(1e-6), on_level_ground)));

  for (size_t i = 0; i < kJointVelocities; ++i) observation[kVelocities + i] *= kControlStep;
  std::fill_n(observation.begin() + kHeights, 100, 0.7);
  observation[kHeights + 45] = 0.3 + kRise;
  observation[kHeights + 55] = 0.3;  // under the body
  EXPECT_THAT(Act(official, observation), Pointwise(DoubleNear(1e-6), before_a_rise));
}

// Every profile accepts its parameter sets, and it stays on its feet and on the track for two seconds.
TEST(Walker, WalksInEveryProfile) {
  for (const std::string profile : {"paper", "myosuite", "as-graded"}) {
    Walker walker = ShippedWalker(profile);
    const nlohmann::json rules = sim::ShippedRules(profile);
    const auto course = CourseOf(rules);
    EXPECT_EQ(Walk(*course, walker, kSeed, 400).size(), 400 * kWalkerAction) << profile;
    EXPECT_LT(course->data().qpos[1], rules["start"]["y_m"].get<double>() - 1) << profile;
  }
}

}  // namespace
}  // namespace myograde::baseline
