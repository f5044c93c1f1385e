// The baseline of die reorientation, on the graded simulator.
#include "policies/baseline/turner.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/sim/reorientation/helpers.h"

namespace myograde::baseline {
namespace {

constexpr uint64_t kDieSeed = 5'000'000'001;

// A turn that only cups the hand, with an outcome there.
Turn Cupped(const std::array<double, 3>& rotation, double share) {
  std::vector<double> numbers;
  for (const ParameterInfo& info : TurnParameters()) numbers.push_back(info.start);
  Turn turn = MakeTurn(numbers);
  turn.outcomes = {{.rotation = rotation, .share = share}};
  return turn;
}

TEST(Turn, PromisesMoreTheNearerAndTheOftener) {
  const std::array<double, 3> goal = {1, 0, 0}, here{};
  EXPECT_EQ(Cupped({1, 0, 0}, 0.5).Promise(goal, here), 0.5);
  EXPECT_GT(Cupped({0.9, 0, 0}, 0.5).Promise(goal, here),
            Cupped({0.8, 0, 0}, 0.5).Promise(goal, here));
  EXPECT_GT(Cupped({0.9, 0, 0}, 0.6).Promise(goal, here),
            Cupped({0.9, 0, 0}, 0.5).Promise(goal, here));
  EXPECT_LT(Cupped({1, 0, 0}, 0.5).Promise(goal, std::array{0.01, 0.0, 0.0}), 0.5);
  Turn two = Cupped({3, 0, 0}, 1);
  two.outcomes.push_back({.rotation = goal, .share = 0.25});
  EXPECT_EQ(two.Promise(goal, here), 0.25);
}

TEST(Turn, HasPosturesThatBeginInTurn) {
  std::vector<double> numbers;
  for (const ParameterInfo& info : TurnParameters()) numbers.push_back(info.start);
  numbers[0] = 12;
  numbers[3 + 16 + 5] = 1;  // the second posture's thumb_bend
  const Turn turn = MakeTurn(numbers);
  EXPECT_THAT(turn.begins, testing::ElementsAre(0, 12, 70, 105));
  HandPosture change{};
  for (size_t j = 0; j < change.size(); ++j) change[j] = turn.postures[1][j] - turn.postures[0][j];
  HandPosture bent{};
  bent[5] = 1;
  bent[6] = 0.5;
  EXPECT_THAT(change, testing::Pointwise(testing::DoubleEq(), bent));
}

// The observation after an episode with the turner.
std::vector<double> Play(sim::Environment& env, Turner& turner) {
  env.SetConvention(ActionConvention::kDirect);
  env.Reset(kDieSeed);
  turner.Reset();
  std::vector<double> observation(kTurnerObservation), action(kHandActions);
  for (bool over = false; !over;) {
    env.Observe(observation);
    turner.Act(std::span(observation).first<kTurnerObservation>(),
               std::span<double, kHandActions>(action));
    EXPECT_THAT(action, testing::Each(testing::AllOf(testing::Ge(0), testing::Le(1))));
    over = env.Step(action).ended;
  }
  return observation;
}

TEST(Turner, PlaysTheTurnForTheGoalAndBeginsAfreshAfterAReset) {
  const auto env = sim::MakeDie();
  env->Reset(kDieSeed);
  std::vector<double> first(kTurnerObservation);
  env->Observe(first);
  const std::array<double, 3> goal = {first[57], first[58], first[59]};
  Turn other = Cupped({goal[0] + 1, goal[1], goal[2]}, 1);
  other.postures.fill(HandPosture{});
  Turner right({other, Cupped(goal, 1)}), only({Cupped({}, 1)}), wrong({other});
  const std::vector<double> seen = Play(*env, right);
  EXPECT_EQ(seen, Play(*env, only));
  EXPECT_NE(seen, Play(*env, wrong));
  EXPECT_EQ(seen, Play(*env, right));
}

TEST(Turner, ReadsTheShippedTurnsAndRefusesOthers) {
  const std::string folder = std::string(MYOGRADE_SOURCE_DIR) + "/policies/baseline/parameters/";
  for (const Turn& turn : ReadTurns(folder + "reorientation.json")) {
    EXPECT_FALSE(turn.outcomes.empty());
  }
  EXPECT_THROW(ReadTurns(folder + "baoding.json"), std::runtime_error);
  EXPECT_THROW(ReadTurns(folder + "none.json"), std::runtime_error);
}

}  // namespace
}  // namespace myograde::baseline
