// The table of the arm's muscles against the model, and how torques are shared out among them.
#include "policies/baseline/arm_muscles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "policies/baseline/reacher.h"
#include "policies/baseline/reacher_parameters.h"
#include "sim/manipulation/track.h"
#include "sim/model/model.h"
#include "tests/sim/golden.h"

namespace myograde::baseline {
namespace {

// A posture beside the box.
ArmState Beside() {
  ArmState state;
  state.angles = {0.5, 0.8, -0.4, 0.8, 0.3, 0.2, 0.5, -0.3, 0.2, 0.1};
  return state;
}

TEST(ArmMuscles, TorquesAreTheModels) {
  auto model = sim::LoadModel(sim::ManipulationModel(), sim::CacheDir());
  ASSERT_TRUE(model.ok()) << model.status();
  const mjModel& m = **model;
  const sim::DataPtr data(mj_makeData(&m));
  ArmState state = Beside();
  const std::array<const char*, 7> names = {"elv_angle",     "shoulder_elv", "shoulder_rot",
                                            "elbow_flexion", "pro_sup",      "deviation",
                                            "flexion"};
  std::array<int, 7> joint;
  for (int j = 0; j < 7; ++j) {
    joint[j] = mj_name2id(&m, mjOBJ_JOINT, names[j]);
    data->qpos[m.jnt_qposadr[joint[j]]] = state.angles[j];
  }
  for (int j = 7; j < kArmJoints; ++j) {  // the hand's joints follow one another in the model
    data->qpos[m.jnt_qposadr[joint[6] + j - 6]] = state.angles[j];
  }
  std::array<std::vector<std::pair<int, double>>, 7> dragged;  // joints and their slopes
  for (int i = 0; i < m.neq; ++i) {  // the shoulder blade, which the shoulder drags along
    const auto driver = std::ranges::find(joint, m.eq_obj2id[i]);
    if (m.eq_type[i] != mjEQ_JOINT || driver == joint.end()) continue;
    const mjtNum* polynomial = m.eq_data + i * mjNEQDATA;
    ASSERT_THAT(std::span(polynomial + 2, 3), testing::Each(0));
    data->qpos[m.jnt_qposadr[m.eq_obj1id[i]]] =
        polynomial[0] + polynomial[1] * data->qpos[m.jnt_qposadr[*driver]];
    dragged[driver - joint.begin()].emplace_back(m.eq_obj1id[i], polynomial[1]);
  }
  state.activation.fill(0.2);
  std::fill_n(data->act, kArmMuscles, 0.2);
  mj_forward(&m, data.get());
  const ArmTorques torques = MuscleTorques(state);
  // In N m. The shoulder's rotation and the elbow are the table's weakest: it misses moment arms of
  // BIClong and TRIlong by centimetres.
  const std::array<double, 7> tolerance = {0.7, 0.7, 2.8, 1.7, 0.4, 0.2, 0.6};
  for (int j = 0; j < 7; ++j) {
    double of_model = data->qfrc_actuator[m.jnt_dofadr[joint[j]]];
    for (const auto& [other, slope] : dragged[j]) {
      of_model += slope * data->qfrc_actuator[m.jnt_dofadr[other]];
    }
    EXPECT_NEAR(torques[j], of_model, tolerance[j]) << names[j];
  }
}

TEST(ArmMuscles, PullAgainstTheSlopeOfTheirLengths) {
  ArmState state = Beside();
  const ArmTorques passive = MuscleTorques(state);
  state.activation[22] = 1;  // brachialis, which bends the elbow alone
  const ArmTorques active = MuscleTorques(state);
  for (int j = 0; j < kArmJoints; ++j) {
    if (j == 3) {
      EXPECT_GT(active[j] - passive[j], 5);
    } else {
      EXPECT_DOUBLE_EQ(active[j], passive[j]);
    }
  }
}

TEST(ArmMuscles, TheWeightPullsTheLiftedArmDown) {
  const ArmTorques weight = WeightTorques(Beside());
  EXPECT_GT(weight[1], 2);  // elevation of the shoulder, N m
  EXPECT_LT(weight[1], 20);
  for (int j = kChainAngles; j < kArmJoints; ++j) EXPECT_EQ(weight[j], 0);
}

TEST(ArmAllocator, ReachesTorquesWithinSomeSteps) {
  ArmState state = Beside();
  ArmTorques goal{}, weight{};
  goal[1] = 10;
  goal[3] = 5;
  for (int j = 0; j < 4; ++j) weight[j] = 1;
  ArmAllocator allocator(0.05);
  std::array<double, kArmMuscles> excitations;
  for (int step = 0; step < 30; ++step) {
    allocator.Allocate(state, goal, weight, excitations);
    EXPECT_THAT(excitations, testing::Each(testing::AllOf(testing::Ge(0), testing::Le(1))));
    for (int i = 0; i < kArmMuscles; ++i) {  // as if the muscles had no delay but the bounds'
      state.activation[i] += 0.3 * (excitations[i] - state.activation[i]);
    }
  }
  const ArmTorques torques = MuscleTorques(state);
  EXPECT_NEAR(torques[1], 10, 1.5);
  EXPECT_NEAR(torques[3], 5, 1);
}

std::array<double, kReacherAction> ActionAfter(Reacher& reacher, int steps) {
  std::array<double, kReacherObservation> observation{};
  std::array<double, kReacherAction> action{};
  for (int step = 0; step < steps; ++step) {
    observation[0] = 0.01 * step;
    observation[11] = 0.8 + 0.001 * step;
    observation[129] = -0.4;  // the box
    observation[131] = 1.13;
    observation[132] = 1;
    reacher.Act(observation, action);
  }
  return action;
}

TEST(Reacher, ActsTheSameAfterAReset) {
  Reacher reacher(ReadReacherPlan(std::string(MYOGRADE_SOURCE_DIR) +
                                  "/policies/baseline/parameters/manipulation.json"));
  reacher.Reset();
  const auto first = ActionAfter(reacher, 40);
  reacher.Reset();
  EXPECT_EQ(ActionAfter(reacher, 40), first);
  for (size_t i = 0; i < kArmMuscles; ++i) {
    EXPECT_GE(first[i], 0);
    EXPECT_LE(first[i], 1);
  }
}

TEST(ReacherPlan, ItsNumbersAreItsParameters) {
  std::vector<double> numbers;
  for (const ParameterInfo& info : ReacherParameters()) numbers.push_back(info.start);
  EXPECT_NE(MakePlan(numbers).give.turn[2], 0.3);
  for (size_t i = 0; i < numbers.size(); ++i) {
    if (ReacherParameters()[i].name == std::string("give_turn_z")) numbers[i] = 0.3;
  }
  EXPECT_EQ(MakePlan(numbers).give.turn[2], 0.3);
}

TEST(ReacherPlan, SaysWhatIsMissing) {
  const std::string path = testing::TempDir() + "incomplete_plan.json";
  std::ofstream(path) << R"({"parameters": {"stiffness_elevation_plane": 60}})";
  EXPECT_THAT([&] { ReadReacherPlan(path); },
              testing::ThrowsMessage<std::runtime_error>(
                  testing::HasSubstr("has no number \"stiffness_elevation\"")));
}

}  // namespace
}  // namespace myograde::baseline
