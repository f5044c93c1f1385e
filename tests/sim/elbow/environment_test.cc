// Episodes of the elbow environment: resets, actions, holding, ends, and each switch of the
// profiles.
#include "sim/elbow/environment.h"

#include <algorithm>
#include <cmath>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/sim/elbow/helpers.h"

namespace myograde::sim {
namespace {

constexpr int kObservations = 9;
constexpr double kJointEnd = 2.26893;  // rad

const std::vector<double>& Rest() {
  static const std::vector<double> rest(6, -1.0);
  return rest;
}

std::vector<double> Observed(const ElbowEnvironment& env) {
  std::vector<double> observation(env.observation_size());
  env.Observe(observation);
  return observation;
}

std::vector<double> StateAfterWaves(ElbowEnvironment& env, uint64_t seed) {
  env.Reset(seed);
  std::vector<double> action(6);
  for (int t = 0; t < 20; ++t) {
    for (int i = 0; i < 6; ++i) action[i] = std::sin(0.2 * t + i);
    env.Step(action);
  }
  return {env.state().begin(), env.state().end()};
}

// Plays `steps` steps, each from rest at `away` (rad) from the target, or fewer if the episode
// ends. A step from rest moves the elbow by less than 0.03 rad.
StepResult StayAt(ElbowEnvironment& env, double away, int steps) {
  StepResult result;
  const double side = env.target() < 1 ? 1 : -1;
  for (int i = 0; i < steps && !result.ended; ++i) {
    PutElbow(env, env.target() + side * away);
    result = env.Step(Rest());
  }
  return result;
}

TEST(ElbowEnvironment, TheSameSeedGivesTheSameEpisodeBitForBit) {
  for (const char* profile : {"hold", "myosuite"}) {
    const auto one = MakeElbowProfile(profile);
    const auto two = MakeElbowProfile(profile);
    const std::vector<double> first = StateAfterWaves(*one, 7);
    EXPECT_EQ(first, StateAfterWaves(*two, 7)) << profile;
    StateAfterWaves(*one, 8);
    EXPECT_EQ(first, StateAfterWaves(*one, 7)) << "nothing is left of the episode before";
  }
}

TEST(ElbowEnvironment, DifferentSeedsGiveDifferentTargetsAndStarts) {
  const auto env = MakeElbowProfile("hold");
  std::set<double> targets;
  std::set<double> starts;
  for (uint64_t seed = 0; seed < 50; ++seed) {
    env->Reset(seed);
    targets.insert(env->target());
    starts.insert(env->state()[1]);
  }
  EXPECT_EQ(targets.size(), 50);
  EXPECT_EQ(starts.size(), 50);
}

TEST(ElbowEnvironment, DrawsFillTheirRangesAndStayInThem) {
  for (const char* profile : {"hold", "myosuite"}) {
    const auto env = MakeElbowProfile(profile);
    const double end = env->rules().target_range_rad[1];
    double largest_target = 0;
    double largest_start = 0;
    for (uint64_t seed = 0; seed < 300; ++seed) {
      env->Reset(seed);
      const double start = FactsOf(*env).start_angle;
      ASSERT_TRUE(env->target() >= 0 && env->target() <= end);
      ASSERT_TRUE(start >= 0 && start <= kJointEnd);
      largest_target = std::max(largest_target, env->target());
      largest_start = std::max(largest_start, start);
    }
    EXPECT_GT(largest_target, 0.98 * end);
    EXPECT_GT(largest_start, 0.98 * kJointEnd);
  }
}

TEST(ElbowEnvironment, LegParameterSetsAreRefused) {
  const auto env = MakeElbowProfile("hold");
  EXPECT_TRUE(env->SetParameters(nlohmann::json::object()).ok());
  EXPECT_EQ(env->SetParameters({{"0", {}}}).code(), absl::StatusCode::kInvalidArgument);
}

TEST(ElbowActions, NormalizedFollowsTheOfficialCurve) {
  const auto env = MakeElbowProfile("hold");
  env->Reset(0);
  env->Step(std::vector<double>{-1, 0, 0.5, 1, 0, 0});
  EXPECT_DOUBLE_EQ(env->data().ctrl[0], 1 / (1 + std::exp(7.5)));
  EXPECT_DOUBLE_EQ(env->data().ctrl[1], 1 / (1 + std::exp(2.5)));
  EXPECT_DOUBLE_EQ(env->data().ctrl[2], 0.5);
  EXPECT_DOUBLE_EQ(env->data().ctrl[3], 1 / (1 + std::exp(-2.5)));
  EXPECT_EQ(env->facts().clipped, 0);
}

TEST(ElbowActions, DirectIsTheExcitationItself) {
  const auto env = MakeElbowProfile("hold");
  env->SetConvention(ActionConvention::kDirect);
  env->Reset(0);
  const std::vector<double> action = {0, 0.2, 0.4, 0.6, 0.8, 1};
  env->Step(action);
  EXPECT_TRUE(std::ranges::equal(action, std::span(env->data().ctrl, 6)));
}

TEST(ElbowActions, OutOfRangeIsClippedAndCountedUnlessTheProfileIsOfficial) {
  for (const bool direct : {false, true}) {
    const std::vector<double> wild = {-3, 5, 0.5, 0.5, 1, 1.5};
    const auto convention = direct ? ActionConvention::kDirect : ActionConvention::kNormalized;
    const auto clipping = MakeElbowProfile("hold");
    clipping->SetConvention(convention);
    clipping->Reset(1);
    clipping->Step(wild);
    EXPECT_EQ(clipping->facts().clipped, 3);
    EXPECT_EQ(clipping->data().ctrl[1], clipping->data().ctrl[4]);
    const auto official = MakeElbowProfile("myosuite");
    official->SetConvention(convention);
    official->Reset(1);
    official->Step(wild);
    EXPECT_EQ(official->facts().clipped, 0);
    EXPECT_GT(official->data().ctrl[1], official->data().ctrl[4]);
  }
}

TEST(ElbowObservation, HoldsAngleVelocityErrorAndActivationsInThatOrder) {
  const auto env = MakeElbowProfile("hold");
  StateAfterWaves(*env, 3);
  const std::vector<double> seen = Observed(*env);
  ASSERT_EQ(seen.size(), kObservations);
  EXPECT_EQ(seen[0], env->data().qpos[0]);
  EXPECT_EQ(seen[1], env->data().qvel[0]);
  EXPECT_NE(seen[1], 0);
  EXPECT_EQ(seen[2], env->target() - env->data().qpos[0]);
  for (int i = 0; i < 6; ++i) EXPECT_EQ(seen[3 + i], env->data().act[i]);
}

TEST(ElbowObservation, TheOfficialVelocityIsTimesTheStep) {
  ElbowRules rules = ElbowRulesOf("hold");
  rules.velocities_times_step = true;
  const auto official = MakeElbowWith(rules);
  const auto plain = MakeElbowProfile("hold");
  StateAfterWaves(*official, 3);
  StateAfterWaves(*plain, 3);
  EXPECT_DOUBLE_EQ(Observed(*official)[1], 0.02 * Observed(*plain)[1]);
  EXPECT_EQ(Observed(*official)[0], Observed(*plain)[0]);
}

TEST(ElbowEnd, HoldingTheTargetEndsTheEpisode) {
  const auto env = MakeElbowProfile("hold");
  env->Reset(2);
  const StepResult result = StayAt(*env, 0, 100);
  EXPECT_TRUE(result.ended);
  EXPECT_EQ(env->facts().end, ElbowEnd::kHeld);
  EXPECT_EQ(env->facts().steps, 25);
  EXPECT_TRUE(FactsOf(*env).held);
  EXPECT_EQ(FactsOf(*env).longest_run, 25);
}

TEST(ElbowEnd, LeavingTheTargetBeginsTheCountAnew) {
  const auto env = MakeElbowProfile("hold");
  env->Reset(2);
  EXPECT_FALSE(StayAt(*env, 0, 24).ended);
  EXPECT_FALSE(StayAt(*env, 0.3, 1).ended);
  EXPECT_FALSE(StayAt(*env, 0, 24).ended);
  EXPECT_FALSE(FactsOf(*env).held);
  EXPECT_EQ(FactsOf(*env).longest_run, 24);
  EXPECT_EQ(FactsOf(*env).tolerance_steps, 48);
  EXPECT_TRUE(StayAt(*env, 0, 1).ended);
}

TEST(ElbowEnd, TwoSecondsAreOverAfterAHundredSteps) {
  for (const char* profile : {"hold", "myosuite"}) {
    const auto env = MakeElbowProfile(profile);
    env->Reset(2);
    EXPECT_FALSE(StayAt(*env, 0.5, 99).ended);
    EXPECT_TRUE(StayAt(*env, 0.5, 1).ended);
    EXPECT_EQ(env->facts().end, EpisodeEnd::kTime);
    EXPECT_EQ(env->facts().steps, 100);
    EXPECT_NEAR(env->facts().sim_time, 2, 1e-12);
    EXPECT_NEAR(FactsOf(*env).reported_time, 2, 1e-12);
    EXPECT_FALSE(FactsOf(*env).held);
  }
}

TEST(ElbowEnd, HoldingCountsInTheLastStepToo) {
  ElbowRules rules = ElbowRulesOf("hold");
  rules.max_steps = rules.hold_steps;
  const auto env = MakeElbowWith(rules);
  env->Reset(2);
  StayAt(*env, 0, 100);
  EXPECT_EQ(env->facts().end, ElbowEnd::kHeld);
}

TEST(ElbowEnd, HoldingDoesNotEndAnOfficialEpisode) {
  const auto env = MakeElbowProfile("myosuite");
  env->Reset(2);
  StayAt(*env, 0, 100);
  EXPECT_EQ(env->facts().end, EpisodeEnd::kTime);
  EXPECT_EQ(env->facts().steps, 100);
  EXPECT_TRUE(FactsOf(*env).held);
  EXPECT_EQ(FactsOf(*env).solved_steps, 100);
}

TEST(ElbowFacts, TheFlagAndTheToleranceAreTwoThings) {
  const auto env = MakeElbowProfile("hold");
  env->Reset(2);
  StayAt(*env, 0.11, 30);  // outside the tolerance, where the official flag is up
  EXPECT_EQ(FactsOf(*env).tolerance_steps, 0);
  EXPECT_EQ(FactsOf(*env).solved_steps, 30);
  EXPECT_TRUE(FactsOf(*env).solved);
  StayAt(*env, 0.4, 1);
  EXPECT_FALSE(FactsOf(*env).solved);
  EXPECT_EQ(FactsOf(*env).solved_steps, 30);
}

TEST(ElbowFacts, ErrorsAreThoseOfTheSteps) {
  const auto env = MakeElbowProfile("hold");
  env->Reset(4);
  const double first = std::abs(env->target() - FactsOf(*env).start_angle);
  EXPECT_EQ(FactsOf(*env).target_angle, env->target());
  EXPECT_EQ(FactsOf(*env).final_error, first);
  EXPECT_EQ(FactsOf(*env).smallest_error, first);
  double smallest = 10;
  double sum = 0;
  for (int i = 0; i < 40; ++i) {
    env->Step(std::vector<double>(6, 0.4));
    const double error = std::abs(Observed(*env)[2]);
    EXPECT_EQ(FactsOf(*env).final_error, error);
    smallest = std::min(smallest, error);
    sum += error;
  }
  EXPECT_EQ(FactsOf(*env).smallest_error, smallest);
  EXPECT_DOUBLE_EQ(FactsOf(*env).error_sum, sum);
}

TEST(ElbowFacts, EffortIsTheNormOfTheActivationsOverSix) {
  const auto env = MakeElbowProfile("hold");
  env->Reset(4);
  double sum = 0;
  for (int i = 0; i < 10; ++i) {
    env->Step(std::vector<double>(6, 0.4));
    double square = 0;
    for (int k = 0; k < 6; ++k) square += env->data().act[k] * env->data().act[k];
    sum += std::sqrt(square) / 6;
  }
  EXPECT_NEAR(FactsOf(*env).effort_sum, sum, 1e-14);
  EXPECT_GT(sum, 0);
}

TEST(ElbowFaults, BadNumbersAreUnstableOrResetTheOfficialSimulation) {
  const auto strict = MakeElbowProfile("hold");
  strict->Reset(0);
  strict->data().qvel[0] = 1e12;
  EXPECT_TRUE(strict->Step(Rest()).unstable);

  const auto official = MakeElbowProfile("myosuite");
  official->Reset(0);
  official->Step(Rest());
  official->data().qvel[0] = 1e12;
  const StepResult result = official->Step(Rest());
  EXPECT_FALSE(result.unstable);
  EXPECT_EQ(official->data().time, 0);
  EXPECT_EQ(official->data().qpos[0], 0) << "back to the model's start, as the official code does";
}

TEST(ElbowDetails, TellSinceWhenTheElbowHasBeenWithinTheTolerance) {
  const auto env = MakeElbowProfile("hold");
  env->Reset(1);
  EXPECT_FALSE(env->details().has_value());
  const auto settled = [&] {
    return std::get<ElbowDetails>(env->details().value()).settle_time;
  };
  const double tolerance = env->rules().tolerance_rad;
  StayAt(*env, tolerance + 0.2, 2);
  EXPECT_EQ(settled(), std::nullopt);
  StayAt(*env, 0, 1);
  const double first = env->data().time;
  EXPECT_EQ(settled(), first);
  StayAt(*env, 0, 2);
  EXPECT_EQ(settled(), first);
  StayAt(*env, tolerance + 0.2, 1);
  EXPECT_EQ(settled(), std::nullopt) << "it did not stay";
  StayAt(*env, 0, 1);
  EXPECT_EQ(settled(), env->data().time);
  const JointRange elbow = std::get<ElbowDetails>(env->details().value()).joint_ranges[0];
  EXPECT_GT(elbow.high - elbow.low, 0.1);
  EXPECT_NEAR(elbow.limit_high, kJointEnd, 1e-4);
  env->Reset(1);
  EXPECT_FALSE(env->details().has_value());
}

}  // namespace
}  // namespace myograde::sim
