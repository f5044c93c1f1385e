// The baseline of relocation, on the graded simulator.
#include "policies/baseline/carrier.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <span>
#include <string>
#include <vector>

#include "policies/baseline/parameter_file.h"
#include "policies/baseline/reacher_parameters.h"
#include "tests/sim/relocation/helpers.h"

namespace myograde::baseline {
namespace {

using Action = std::array<double, kArmMuscles>;

constexpr uint64_t kCarriedSeed = 5'000'000'250;

Carrier Shipped() {
  return Carrier(MakeCarrierPlan(ReadNumbers(
      std::string(MYOGRADE_SOURCE_DIR) + "/policies/baseline/parameters/relocation.json",
      CarrierParameters())));
}

// The last observation of an episode.
std::vector<double> Play(sim::Environment& env, Carrier& carrier) {
  env.SetConvention(ActionConvention::kDirect);
  env.Reset(kCarriedSeed);
  carrier.Reset();
  std::vector<double> observation(static_cast<size_t>(env.observation_size()));
  Action action{};
  for (bool ended = false; !ended;) {
    env.Observe(observation);
    carrier.Act(std::span(observation).first<kCarrierObservation>(), action);
    EXPECT_THAT(action, testing::Each(testing::AllOf(testing::Ge(0), testing::Le(1))));
    ended = env.Step(action).ended;
  }
  env.Observe(observation);
  return observation;
}

TEST(Carrier, CarriesTheObjectIntoTheBinAndBeginsAfreshAfterAReset) {
  const auto env = sim::MakeObject();
  Carrier carrier = Shipped();
  const std::vector<double> seen = Play(*env, carrier);
  EXPECT_GT(sim::FactsOf(*env).solved_steps, 5);
  EXPECT_EQ(Play(*env, carrier), seen);
}

// What it does in the step after `first` and `second` were seen.
Action SecondAction(double first, double second) {
  Carrier carrier = Shipped();
  carrier.Reset();
  std::array<double, kCarrierObservation> observation{};
  observation[14] = 1.5;  // the elbow
  Action action{};
  for (const double x : {first, second}) {
    observation[75] = observation[78] = x;
    carrier.Act(observation, action);
  }
  return action;
}

// A reset's observation may show another object than there is.
TEST(Carrier, DoesNotGoByTheFirstObservation) {
  EXPECT_EQ(SecondAction(-0.3, -0.1), SecondAction(-0.1, -0.1));
}

TEST(CarrierPlan, ItsNumbersAreItsParameters) {
  std::vector<double> numbers;
  for (const ParameterInfo& info : CarrierParameters()) numbers.push_back(info.start);
  EXPECT_NE(MakeCarrierPlan(numbers).over.turn[2], 0.3);
  for (size_t i = 0; i < numbers.size(); ++i) {
    if (CarrierParameters()[i].name == std::string("over_turn_z")) numbers[i] = 0.3;
  }
  EXPECT_EQ(MakeCarrierPlan(numbers).over.turn[2], 0.3);
}

}  // namespace
}  // namespace myograde::baseline
