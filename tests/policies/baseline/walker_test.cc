// What the walker does on the graded course.
#include "policies/baseline/walker.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "policies/baseline/parameter_file.h"
#include "tests/policies/baseline/walking.h"
#include "tests/sim/locomotion/fixture.h"

namespace myograde::baseline {
namespace {

using ::testing::AllOf;
using ::testing::Each;
using ::testing::Ge;
using ::testing::Le;

constexpr uint64_t kSeed = 7'000'000'000;  // neither graded nor of the search

}  // namespace

Walker ShippedWalker() {
  return Walker(ReadWalkerNumbers(std::string(MYOGRADE_SOURCE_DIR) +
                                  "/policies/baseline/parameters/locomotion.json"));
}

std::unique_ptr<sim::Locomotion> CourseFor(const Walker& walker) {
  auto course = sim::MakeEnvironment(sim::ParsedRules(sim::ShippedRules("paper")));
  course->SetConvention(ActionConvention::kDirect);
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
  course->Reset(kSeed);
  EXPECT_TRUE(course->SetLegParameters(sets).ok());
  return course;
}

std::vector<double> Walk(sim::Locomotion& course, Walker& walker, uint64_t seed, int steps) {
  course.Reset(seed);
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
  const auto course = CourseFor(walker);
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

}  // namespace
}  // namespace myograde::baseline
