// The parameter sets that the prosthesis starts with: data of the config.
#include <cmath>
#include <cstring>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "sim/locomotion/leg.h"
#include "tests/sim/locomotion/fixture.h"

namespace myograde::sim {
namespace {

LegRules Rules(const std::string& profile) { return ParsedRules(ShippedRules(profile)).leg; }

std::string Bytes(const LegSet& set) {
  return {reinterpret_cast<const char*>(set.data()), sizeof(set)};
}

TEST(LegSets, PaperHasFiveThatDiffer) {
  const LegRules rules = Rules("paper");
  ASSERT_EQ(rules.parameter_sets.size(), 5u);
  std::set<std::string> sets, names;
  for (const LegSetRules& set : rules.parameter_sets) {
    sets.insert(Bytes(MakeLegSet(set)));
    names.insert(set.name);
  }
  EXPECT_EQ(sets.size(), 5u);
  EXPECT_EQ(names.size(), 5u);
}

TEST(LegSets, TheFirstIsTheOfficialDefaultToTheBit) {
  EXPECT_EQ(Bytes(MakeLegSet(Rules("paper").parameter_sets[0])), Bytes(DefaultLegSet()));
}

TEST(LegSets, TheOfficialProfilesHaveCopiesOfOne) {
  for (const char* profile : {"myosuite", "as-graded"}) {
    EXPECT_TRUE(Rules(profile).parameter_sets.empty()) << profile;
    LegController leg(Rules(profile));
    const LegSensors sensors{.load = 10, .knee_angle = 0.5, .ankle_angle = 0.05};
    const LegTorques first = leg.Update(sensors);
    for (int set = 1; set < 4; ++set) {
      leg.Reset();
      leg.Select(set);
      EXPECT_EQ(leg.Update(sensors).knee, first.knee) << set;
      EXPECT_EQ(leg.Update(sensors).ankle, first.ankle) << set;
    }
  }
}

// What a policy could upload, it may also find.
TEST(LegSets, AreThemselvesWithinTheLimitsOfUploads) {
  const LegRules rules = Rules("paper");
  LegParameterSets sets{};
  sets.present = 31;
  for (size_t i = 0; i < 5; ++i) {
    const LegSet set = MakeLegSet(rules.parameter_sets[i]);
    std::copy(set.begin(), set.end(), std::begin(sets.set[i]));
  }
  LegController leg;
  const absl::Status status = leg.Upload(sets, rules);
  EXPECT_TRUE(status.ok()) << status;
}

TEST(LegSets, ASelectionChangesTheTorqueAndAResetBringsTheSetsBack) {
  const LegRules rules = Rules("paper");
  LegController leg(rules);
  const LegSensors sensors{.load = 300, .knee_angle = 0.5, .ankle_angle = -0.1};
  std::set<double> torques;
  for (int set = 0; set < 5; ++set) {
    leg.Reset();
    leg.Select(set);
    const LegTorques now = leg.Update(sensors);
    torques.insert(now.knee + 1e-3 * now.ankle);
  }
  EXPECT_EQ(torques.size(), 5u);
  LegParameterSets upload{};
  upload.present = 2;
  std::copy(DefaultLegSet().begin(), DefaultLegSet().end(), std::begin(upload.set[1]));
  ASSERT_TRUE(leg.Upload(upload, rules).ok());
  leg.Reset();
  leg.Select(1);
  LegController twin(rules);
  twin.Select(1);
  EXPECT_EQ(leg.Update(sensors).ankle, twin.Update(sensors).ankle);
}

// Standing bears weight without leaving its state, and goes there from any other once loaded.
TEST(LegSets, StandingStaysWhileItBearsWeight) {
  for (int state = 0; state < kLegStates; ++state) {
    LegController leg(Rules("paper"));
    leg.Select(4);
    leg.set_state(static_cast<LegState>(state));
    for (int i = 0; i < 10; ++i) leg.Update({.load = 400});
    EXPECT_TRUE(leg.state() == LegState::kEarlyStance || leg.state() == LegState::kLateStance);
    const LegState bearing = leg.state();
    leg.Update({.load = 400, .knee_angle = 0.3, .ankle_angle = 0.2});
    EXPECT_EQ(leg.state(), bearing);
  }
}

// Played on the model from each posture: a set whose damping or stiffness were too much for a
// step of 5 ms would make the simulation diverge.
TEST(LegSets, AreStableOnTheModel) {
  auto environment = MakeEnvironment(ParsedRules(ShippedRules("paper")));
  for (int set = 0; set < 5; ++set) {
    for (const uint64_t seed : {1, 2, 3, 4, 5, 6}) {
      environment->Reset(seed);
      double fastest = 0;
      StepResult result;
      for (int t = 0; t < 200 && !result.ended; ++t) {
        result = environment->Step(ConstantAction(-1, set));
        EXPECT_FALSE(result.unstable || result.overflow) << set << " " << seed;
        const LegSensors sensors = environment->SenseLeg();
        fastest = std::max({fastest, std::abs(sensors.knee_velocity),
                            std::abs(sensors.ankle_velocity)});
      }
      EXPECT_LT(fastest, 60) << "set " << set << ", seed " << seed;
      RecordProperty("fastest_" + std::to_string(set) + "_" + std::to_string(seed),
                     std::to_string(fastest));
    }
  }
}

}  // namespace
}  // namespace myograde::sim
