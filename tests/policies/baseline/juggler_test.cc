// The hand that follows postures, and the baseline of Baoding balls, on the graded simulator.
#include "policies/baseline/juggler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <string>
#include <vector>

#include "policies/baseline/parameter_file.h"
#include "tests/sim/baoding/helpers.h"

namespace myograde::baseline {
namespace {

constexpr uint64_t kHandSeed = 5'000'000'001;

// A juggler that holds the posture in which searches start, whatever it sees, unless the parameter
// `changed` makes a difference.
Juggler Still(const std::string& changed = "") {
  std::vector<double> numbers;
  for (const ParameterInfo& info : JugglerParameters()) {
    numbers.push_back(info.start + (info.name == changed ? 0.5 : 0));
  }
  return Juggler(numbers);
}

// The observation after up to `steps` steps of an episode.
std::vector<double> Play(sim::Environment& env, Juggler& juggler, int steps) {
  env.SetConvention(ActionConvention::kDirect);
  env.Reset(kHandSeed);
  juggler.Reset();
  std::vector<double> observation(static_cast<size_t>(env.observation_size()));
  std::vector<double> action(kHandActions);
  env.Observe(observation);
  for (int step = 0; step < steps; ++step) {
    juggler.Act(std::span(observation).first<kJugglerObservation>(),
                std::span<double, kHandActions>(action));
    EXPECT_THAT(action, testing::Each(testing::AllOf(testing::Ge(0), testing::Le(1))));
    const bool over = env.Step(action).ended;
    env.Observe(observation);
    if (over) break;
  }
  return observation;
}

TEST(Hand, FollowsAPosture) {
  const auto env = sim::MakeBalls();
  Juggler still = Still();
  const std::vector<double> seen = Play(*env, still, 60);
  // The balls press on it, so that no joint is quite where it should be.
  double away = 0, before = 0;
  const auto joints = JugglerParameters().first(kHandAngles);
  for (size_t j = 0; j < joints.size(); ++j) {
    away += std::abs(joints[j].start - seen[j]) / kHandAngles;
    before += std::abs(joints[j].start - (j == 0 ? -1.57 : 0)) / kHandAngles;
  }
  EXPECT_GT(before, 0.2);
  EXPECT_LT(away, 0.15);
}

TEST(Juggler, KeepsTheBallsAndBeginsAfreshAfterAReset) {
  const auto env = sim::MakeBalls();
  Juggler juggler(
      ReadNumbers(std::string(MYOGRADE_SOURCE_DIR) + "/policies/baseline/parameters/baoding.json",
                  JugglerParameters()));
  const std::vector<double> seen = Play(*env, juggler, 200);
  EXPECT_EQ(env->facts().steps, 200) << "no ball has fallen";
  EXPECT_EQ(Play(*env, juggler, 200), seen);
}

// How far the first action's excitations are from those of a still juggler.
double Change(std::span<const double, kJugglerObservation> observation, const char* changed) {
  Juggler still = Still(), other = Still(changed);
  std::array<double, kHandActions> first{}, second{};
  still.Act(observation, first);
  other.Act(observation, second);
  double most = 0;
  for (size_t i = 0; i < first.size(); ++i) most = std::max(most, std::abs(first[i] - second[i]));
  return most;
}

TEST(Juggler, AFeatureMovesItsJoints) {
  std::array<double, kJugglerObservation> balls{};
  balls[23] = balls[35] = 0.04;  // both lie along x, and so do their targets
  EXPECT_GT(Change(balls, "lie_cos_index"), 0.05);
  EXPECT_EQ(Change(balls, "turn_index"), 0);
  balls[35] = 0;
  balls[36] = 0.04;  // a quarter turn
  EXPECT_GT(Change(balls, "turn_index"), 0.05);
}

}  // namespace
}  // namespace myograde::baseline
