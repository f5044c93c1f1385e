// The walker on two whole legs, and the baseline of chase-tag, on the graded simulator.
#include "policies/baseline/tagger.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "policies/baseline/leg_muscles.h"
#include "policies/baseline/parameter_file.h"
#include "tests/sim/chasetag/helpers.h"

namespace myograde::baseline {
namespace {

using ::testing::AllOf;
using ::testing::Each;
using ::testing::Ge;
using ::testing::Le;
using ::testing::Not;

using Seen = std::array<double, kWholeObservation>;

constexpr uint64_t kWalkSeed = 7'000'000'002;  // neither graded nor of the search
constexpr std::array<const char*, kLengthJoints> kWholeJoints = {
    "hip_flexion_r",  "hip_adduction_r", "hip_rotation_r",   "hip_flexion_l",    "hip_adduction_l",
    "hip_rotation_l", "knee_angle_l",    "ankle_angle_l",    "subtalar_angle_l", "mtp_angle_l",
    "knee_angle_r",   "ankle_angle_r",   "subtalar_angle_r", "mtp_angle_r"};

Tagger ShippedTagger() {
  return Tagger(
      ReadNumbers(std::string(MYOGRADE_SOURCE_DIR) + "/policies/baseline/parameters/chasetag.json",
                  TaggerParameters()));
}

std::vector<double> ActOn(Tagger& tagger, const Seen& seen) {
  std::vector<double> action(kWholeMuscles);
  tagger.Act(seen, std::span<double, kWholeMuscles>(action));
  return action;
}

// The last observation of up to `steps` steps.
Seen Play(sim::ChaseTagEnvironment& env, Tagger& tagger, int steps) {
  env.SetConvention(ActionConvention::kDirect);
  env.Reset(kWalkSeed);
  tagger.Reset();
  Seen seen;
  env.Observe(seen);
  for (int step = 0; step < steps; ++step) {
    const std::vector<double> action = ActOn(tagger, seen);
    EXPECT_THAT(action, Each(AllOf(Ge(0), Le(1))));
    const bool over = env.Step(action).ended;
    env.Observe(seen);
    if (over) break;
  }
  return seen;
}

TEST(WholeLegs, TorquesAreTheModels) {
  const auto env = sim::MakeChase();
  Tagger tagger = ShippedTagger();
  Play(*env, tagger, 20);
  const mjModel& model = env->model();
  const mjData& data = env->data();
  MuscleState state;
  for (size_t j = 0; j < kWholeJoints.size(); ++j) {
    const int joint = mj_name2id(&model, mjOBJ_JOINT, kWholeJoints[j]);
    state.angles[j] = data.qpos[model.jnt_qposadr[joint]];
  }
  std::copy_n(data.act, kWholeMuscles, state.activation.begin());
  std::copy_n(data.actuator_length, kWholeMuscles, state.length.begin());
  std::copy_n(data.actuator_velocity, kWholeMuscles, state.velocity.begin());
  const auto torques = MuscleTorques(state, Legs::kWhole);
  for (size_t j = 0; j < kWholeJoints.size(); ++j) {
    const std::string name = kWholeJoints[j];
    if (name.starts_with("knee")) continue;  // it drags others along, which the model keeps apart
    const int joint = mj_name2id(&model, mjOBJ_JOINT, kWholeJoints[j]);
    const double of_model = data.qfrc_actuator[model.jnt_dofadr[joint]];
    EXPECT_NEAR(torques[j], of_model, 4 + 0.1 * std::abs(of_model)) << name;
  }
}

TEST(Tagger, StaysOnItsFeetAndBeginsAfreshAfterAReset) {
  const auto env = sim::MakeChase();
  Tagger tagger = ShippedTagger();
  const Seen seen = Play(*env, tagger, 200);
  EXPECT_EQ(env->facts().steps, 200);
  EXPECT_GT(env->data().xpos[3 * sim::FindChaseTagScene(env->model())->pelvis_body + 2], 0.7)
      << "m, of the pelvis: it has not fallen";
  EXPECT_EQ(Play(*env, tagger, 200), seen);
}

// What it does at (6.3, 0) m once it knows the task, by the opponent's speeds.
std::vector<double> AtTheEdge(Seen seen, double first, double then) {
  seen[69] = 6.3;  // m
  Tagger tagger = ShippedTagger();
  tagger.Reset();
  for (const double speed : {0.0, first}) {
    seen[67] = speed;
    ActOn(tagger, seen);
  }
  seen[67] = then;
  return ActOn(tagger, seen);
}

TEST(Tagger, DropsWhereNoOpponentComesIfItEvades) {
  const auto env = sim::MakeChase();
  Tagger tagger = ShippedTagger();
  const Seen seen = Play(*env, tagger, 20);
  EXPECT_THAT(AtTheEdge(seen, 3.2, 3.2), Each(0));
  // Those of a chase: standing, wavering, at a limit of its speed.
  for (const auto& [first, then] : {std::pair(0, 0.0), {1.2, 1.3}, {2, 2}, {0.3, 0.3}, {1, 1}}) {
    EXPECT_THAT(AtTheEdge(seen, first, then), Not(Each(0))) << then;
  }
}

TEST(Tagger, TurnsToTheOpponentThatItChases) {
  const auto env = sim::MakeChase();
  Tagger left = ShippedTagger();
  Seen seen = Play(*env, left, 60);
  Tagger right = left;
  seen[67] = 0;
  for (int i = 0; i < 20; ++i) {
    const double heading = std::atan2(seen[72], seen[71]) + (i % 2 == 0 ? 1.5 : -1.5);
    seen[64] = seen[69] + 3 * std::cos(heading);
    seen[65] = seen[70] + 3 * std::sin(heading);
    ActOn(i % 2 == 0 ? left : right, seen);
  }
  EXPECT_NE(ActOn(left, seen), ActOn(right, seen));
}

}  // namespace
}  // namespace myograde::baseline
