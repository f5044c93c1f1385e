// The table of muscles against the model, and how torques are shared out among them.
#include <array>
#include <cmath>
#include <numeric>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "policies/baseline/leg_muscles.h"
#include "policies/baseline/length_terms.h"
#include "tests/policies/baseline/walking.h"

namespace myograde::baseline {
namespace {

constexpr std::array<const char*, kFittedJoints> kJoints = {
    "hip_flexion_r",  "hip_adduction_r", "hip_rotation_r", "hip_flexion_l",    "hip_adduction_l",
    "hip_rotation_l", "knee_angle_l",    "ankle_angle_l",  "subtalar_angle_l", "mtp_angle_l"};
constexpr int kKneeJoint = 6;

MuscleState StateOf(const sim::LocomotionEnvironment& course) {
  const mjModel& model = course.model();
  const mjData& data = course.data();
  MuscleState state;
  for (int j = 0; j < kFittedJoints; ++j) {
    state.angles[j] = data.qpos[model.jnt_qposadr[mj_name2id(&model, mjOBJ_JOINT, kJoints[j])]];
  }
  for (int i = 0; i < kMuscles; ++i) {
    const int actuator = course.indices().muscle[i];
    state.activation[i] = data.act[i];
    state.length[i] = data.actuator_length[actuator];
    state.velocity[i] = data.actuator_velocity[actuator];
  }
  return state;
}

TEST(LengthTerms, SlopesAreThoseOfThePolynomial) {
  const LengthTerms terms({1, 4, 7});
  EXPECT_EQ(terms.size(), 19);  // of first, second and third order: 3 + 6 + 10
  std::vector<double> weights(terms.size());
  std::iota(weights.begin(), weights.end(), 1.0);
  std::array<double, kLengthJoints> angles{};
  angles[1] = 0.3;
  angles[4] = -0.2;
  angles[7] = 0.5;
  std::array<double, 3> slopes{};
  terms.AddSlopes(weights, angles, slopes);
  // d/dx of 1x + 2y + 3z + 4xx + 5xy + 6xz + ... + 10xxx + 11xxy + 12xxz + 13xyy + 14xyz + 15xzz ...
  const double x = 0.3, y = -0.2, z = 0.5;
  EXPECT_NEAR(slopes[0],
              1 + 8 * x + 5 * y + 6 * z + 30 * x * x + 22 * x * y + 24 * x * z + 13 * y * y +
                  14 * y * z + 15 * z * z,
              1e-12);
}

TEST(LegMuscles, TorquesAreTheModels) {
  Walker walker = ShippedWalker();
  const auto course = PaperCourse();
  for (const uint64_t seed : {7'000'000'000, 7'000'000'001, 7'000'000'002}) {
    Walk(*course, walker, seed, 25);  // later a thigh is lifted higher than the table is fitted for
    const MuscleState state = StateOf(*course);
    const auto torques = MuscleTorques(state);
    for (int j = 0; j < kFittedJoints; ++j) {
      if (j == kKneeJoint) continue;  // it drags others along, which the model keeps apart
      const int joint = mj_name2id(&course->model(), mjOBJ_JOINT, kJoints[j]);
      const double of_model = course->data().qfrc_actuator[course->model().jnt_dofadr[joint]];
      EXPECT_NEAR(torques[j], of_model, 4 + 0.1 * std::abs(of_model)) << kJoints[j];
    }
  }
}

TEST(MuscleAllocator, ReachesATorqueWithinSomeSteps) {
  Walker walker = ShippedWalker();
  const auto course = PaperCourse();
  Walk(*course, walker, 7'000'000'000, 5);
  MuscleState state = StateOf(*course);
  state.velocity.fill(0);
  state.activation.fill(0);
  TorqueGoal goal;
  goal.weight.fill(1);
  goal.torque[0] = 40;    // right hip flexion
  goal.torque[7] = -60;   // left ankle, plantarflexion
  MuscleAllocator allocator(1);
  std::array<double, kMuscles> excitations;
  for (int step = 0; step < 20; ++step) {
    allocator.Allocate(state, goal, excitations);
    EXPECT_THAT(excitations, testing::Each(testing::AllOf(testing::Ge(0), testing::Le(1))));
    for (int i = 0; i < kMuscles; ++i) {  // as if the muscles had no delay but the bounds'
      state.activation[i] += 0.3 * (excitations[i] - state.activation[i]);
    }
  }
  const auto torques = MuscleTorques(state);
  EXPECT_NEAR(torques[0], 40, 10);
  EXPECT_NEAR(torques[7], -60, 10);
}

}  // namespace
}  // namespace myograde::baseline
