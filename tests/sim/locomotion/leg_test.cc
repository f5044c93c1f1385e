#include "sim/locomotion/leg.h"

#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

namespace myograde::sim {
namespace {

using ::testing::HasSubstr;

constexpr double kBodyWeight = 78.66887849930261 * 9.81;
const LegRules kRules{.sets = 5, .parameter_sets = {}, .full_torque = true,
                      .max_stiffness = 2000, .max_damping = 200};

constexpr double Radians(double degrees) { return degrees * std::numbers::pi / 180; }

// A reading that leaves none of the four states.
LegSensors Staying(LegState state) {
  switch (state) {
    case LegState::kEarlyStance:
      return {.load = 0.1 * kBodyWeight, .ankle_angle = Radians(0)};
    case LegState::kLateStance:
      return {.load = 0.5 * kBodyWeight};
    case LegState::kEarlySwing:
      return {.knee_angle = Radians(40), .knee_velocity = Radians(10)};
    case LegState::kLateSwing:
      return {.load = 0, .knee_angle = Radians(40)};
  }
  return {};
}

LegState After(LegState state, const LegSensors& sensors) {
  LegController leg;
  leg.set_state(state);
  leg.Update(sensors);
  return leg.state();
}

TEST(Leg, StaysWhileNoConditionHolds) {
  for (int i = 0; i < kLegStates; ++i) {
    const auto state = static_cast<LegState>(i);
    EXPECT_EQ(After(state, Staying(state)), state) << LegStateName(state);
  }
}

TEST(Leg, EachConditionAloneLeavesItsState) {
  LegSensors loaded = Staying(LegState::kEarlyStance);
  loaded.load = 0.2501 * kBodyWeight;
  EXPECT_EQ(After(LegState::kEarlyStance, loaded), LegState::kLateStance);
  LegSensors bent = Staying(LegState::kEarlyStance);
  bent.ankle_angle = Radians(6.01);
  EXPECT_EQ(After(LegState::kEarlyStance, bent), LegState::kLateStance);

  EXPECT_EQ(After(LegState::kLateStance, {.load = 0.1499 * kBodyWeight}), LegState::kEarlySwing);

  LegSensors folded = Staying(LegState::kEarlySwing);
  folded.knee_angle = Radians(50.01);
  EXPECT_EQ(After(LegState::kEarlySwing, folded), LegState::kLateSwing);
  LegSensors slow = Staying(LegState::kEarlySwing);
  slow.knee_velocity = Radians(2.99);
  EXPECT_EQ(After(LegState::kEarlySwing, slow), LegState::kLateSwing);

  LegSensors landed = Staying(LegState::kLateSwing);
  landed.load = 0.401 * kBodyWeight;
  EXPECT_EQ(After(LegState::kLateSwing, landed), LegState::kEarlyStance);
  LegSensors stretched = Staying(LegState::kLateSwing);
  stretched.knee_angle = Radians(29.99);
  EXPECT_EQ(After(LegState::kLateSwing, stretched), LegState::kEarlyStance);
}

TEST(Leg, ConditionsAreStrict) {
  LegSensors at = Staying(LegState::kEarlyStance);
  at.load = DefaultLegSet()[0].threshold[0];
  EXPECT_EQ(After(LegState::kEarlyStance, at), LegState::kEarlyStance);
  at = {.load = DefaultLegSet()[1].threshold[0]};
  EXPECT_EQ(After(LegState::kLateStance, at), LegState::kLateStance);
}

TEST(Leg, MakesOneTransitionAnUpdateAndUsesTheNewGains) {
  LegController leg;
  // Unloaded and slow: every state leaves at once.
  const LegSensors sensors{.load = 0, .knee_angle = 0.2, .knee_velocity = -0.5,
                           .ankle_angle = 0.15, .ankle_velocity = 0.4};
  const LegState order[] = {LegState::kLateStance, LegState::kEarlySwing, LegState::kLateSwing,
                            LegState::kEarlyStance};
  for (const LegState expected : order) {
    const LegTorques torques = leg.Update(sensors);
    ASSERT_EQ(leg.state(), expected);
    const LegStateParameters& p = DefaultLegSet()[static_cast<size_t>(expected)];
    EXPECT_DOUBLE_EQ(torques.knee, p.knee_stiffness * (p.knee_target - 0.2) + 0.5 * p.knee_damping);
    EXPECT_DOUBLE_EQ(torques.ankle,
                     p.ankle_stiffness * (p.ankle_target - 0.15) - 0.4 * p.ankle_damping);
  }
}

TEST(Leg, TorquesSaturateAtTheMotorsPeaks) {
  LegController leg;
  LegTorques torques = leg.Update({.knee_angle = 10, .ankle_angle = -20});
  EXPECT_DOUBLE_EQ(torques.knee, -142.272);
  EXPECT_DOUBLE_EQ(torques.ankle, 168.192);
  leg.Reset();
  torques = leg.Update({.knee_angle = -10, .ankle_angle = 20});
  EXPECT_DOUBLE_EQ(torques.knee, 142.272);
  EXPECT_DOUBLE_EQ(torques.ankle, -168.192);
}

RC_GTEST_PROP(Leg, AnyReadingMovesAtMostOneStateAndKeepsTheLimits, ()) {
  const auto number = [](double scale) {
    return *rc::gen::map(rc::gen::inRange(-1000000, 1000000),
                         [scale](int n) { return n * 1e-6 * scale; });
  };
  LegController leg;
  const int before = *rc::gen::inRange(0, kLegStates);
  leg.set_state(static_cast<LegState>(before));
  const LegTorques torques = leg.Update(
      {number(3000), number(3), number(20), number(1), number(20)});
  const int moved = (static_cast<int>(leg.state()) - before + kLegStates) % kLegStates;
  RC_ASSERT(moved == 0 || moved == 1);
  RC_ASSERT(std::abs(torques.knee) <= 142.272 + 1e-12);
  RC_ASSERT(std::abs(torques.ankle) <= 168.192 + 1e-12);
}

// Uploads ---------------------------------------------------------------------

LegParameterSets OneSet(int index) {
  LegParameterSets sets{};
  sets.present = 1u << index;
  std::copy(DefaultLegSet().begin(), DefaultLegSet().end(), std::begin(sets.set[index]));
  return sets;
}

std::string Refusal(const LegParameterSets& sets, const LegRules& rules = kRules) {
  LegController leg;
  return std::string(leg.Upload(sets, rules).message());
}

struct BadNumber {
  const char* name;
  double LegStateParameters::*member;
  double low;
  double high;
};

TEST(LegUpload, RefusesEveryNumberOutsideItsRange) {
  const BadNumber numbers[] = {
      {"knee_stiffness", &LegStateParameters::knee_stiffness, -0.001, 2000.001},
      {"knee_damping", &LegStateParameters::knee_damping, -0.001, 200.001},
      {"knee_target", &LegStateParameters::knee_target, -0.001, 2.0945},
      {"ankle_stiffness", &LegStateParameters::ankle_stiffness, -0.001, 2000.001},
      {"ankle_damping", &LegStateParameters::ankle_damping, -0.001, 200.001},
      {"ankle_target", &LegStateParameters::ankle_target, -0.5237, 0.5237},
  };
  for (const BadNumber& number : numbers) {
    for (const double value : {number.low, number.high, std::nan(""),
                               std::numeric_limits<double>::infinity()}) {
      LegParameterSets sets = OneSet(2);
      sets.set[2][3].*number.member = value;
      EXPECT_THAT(Refusal(sets), HasSubstr("leg parameter set 2, state l_swing: "));
      EXPECT_THAT(Refusal(sets), HasSubstr(number.name));
      EXPECT_THAT(Refusal(sets), HasSubstr("must be from"));
    }
  }
}

TEST(LegUpload, AcceptsTheEndsOfTheRanges) {
  LegParameterSets sets = OneSet(4);
  LegStateParameters& p = sets.set[4][0];
  p.knee_stiffness = p.ankle_stiffness = 2000;
  p.knee_damping = p.ankle_damping = 0;
  p.knee_target = 2.0944;
  p.ankle_target = -0.5236;
  EXPECT_EQ(Refusal(sets), "");
}

TEST(LegUpload, RefusesBadThresholds) {
  LegParameterSets sets = OneSet(0);
  sets.set[0][1].threshold[0] = std::nan("");
  EXPECT_THAT(Refusal(sets), HasSubstr("set 0, state l_stance: threshold of load"));
  sets = OneSet(0);
  sets.set[0][1].threshold_kind[2] = 3;
  EXPECT_THAT(Refusal(sets), HasSubstr("threshold of knee_velocity has the unknown kind 3"));
  sets = OneSet(0);
  for (auto& kind : sets.set[0][1].threshold_kind) kind = 0;
  EXPECT_THAT(Refusal(sets), HasSubstr("must have at least one"));
  // What is not used may hold anything.
  sets = OneSet(0);
  sets.set[0][1].threshold[3] = std::nan("");
  EXPECT_EQ(Refusal(sets), "");
}

TEST(LegUpload, RefusesSetsThatTheProfileLacks) {
  LegRules four = kRules;
  four.sets = 4;
  EXPECT_EQ(Refusal(OneSet(3), four), "");
  EXPECT_THAT(Refusal(OneSet(4), four), HasSubstr("leg parameter set 4 does not exist"));
}

TEST(LegUpload, IsAllOrNothing) {
  LegController leg;
  LegParameterSets sets = OneSet(0);
  sets.set[0][0].knee_stiffness = 50;
  sets.present |= 2;  // set 1 has no thresholds at all
  EXPECT_FALSE(leg.Upload(sets, kRules).ok());
  leg.Select(0);
  const LegSensors sensors{.load = 10, .knee_angle = 0.5};
  EXPECT_DOUBLE_EQ(leg.Update(sensors).knee, 99.372 * (Radians(5) - 0.5));
}

TEST(LegUpload, ActsWhenSelectedAndEndsWithAReset) {
  const LegSensors sensors{.load = 10, .knee_angle = 0.5};
  const double fallback = 99.372 * (Radians(5) - 0.5);
  LegController leg;
  LegParameterSets sets = OneSet(3);
  sets.set[3][0].knee_stiffness = 10;
  ASSERT_TRUE(leg.Upload(sets, kRules).ok());
  EXPECT_DOUBLE_EQ(leg.Update(sensors).knee, fallback);
  leg.Select(3);
  EXPECT_DOUBLE_EQ(leg.Update(sensors).knee, 10 * (Radians(5) - 0.5));
  leg.Reset();
  EXPECT_EQ(leg.selected(), 0);
  leg.Select(3);
  EXPECT_DOUBLE_EQ(leg.Update(sensors).knee, fallback);
}

}  // namespace
}  // namespace myograde::sim
