#include "policies/baseline/arm_follower.h"

#include <algorithm>
#include <cmath>

namespace myograde::baseline {
namespace {

constexpr double kMostIntegral = 0.3;     // rad
constexpr double kMostAcceleration = 60;  // rad/s^2, that is planned
constexpr double kLeastInertia = 0.02;    // kg m^2, of a joint that is moved at a rate
constexpr ChainAngles kMostTorque = {20, 35, 30, 50, 10, 12, 15};             // N m
constexpr ChainAngles kFriction = {1.05, 1.05, 1.05, 0.75, 0.5, 0.25, 0.25};  // N m s/rad
constexpr double kHandWeight = 20;  // what torques of the hand's joints matter more
constexpr int kArmSolverSteps = 4;
constexpr size_t kElevationPlane = 10, kElevation = 11, kRotation = 13;

}  // namespace

size_t ModelJoint(int joint) {
  if (joint == 0) return kElevationPlane;
  return joint == 1 ? kElevation : kRotation + static_cast<size_t>(joint) - 2;
}

double Smooth(double x) {
  const double t = std::clamp(x, 0.0, 1.0);
  return t * t * t * (10 - 15 * t + 6 * t * t);
}

Eigen::Vector3d Vec(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }

Eigen::Quaterniond Turned(const std::array<double, 3>& turn, const Eigen::Quaterniond& nominal) {
  const Eigen::Vector3d v = Vec(turn);
  const double angle = v.norm();
  if (angle < 1e-9) return nominal;
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, v / angle)) * nominal;
}

Eigen::Quaterniond ArmTurn(const std::array<double, 3>& turn) {
  static const Eigen::Quaterniond nominal = MuscleArm().Of(kPalmBeside).turn;
  return Turned(turn, nominal);
}

Pose Between(const Pose& from, const Pose& to, double share) {
  return {from.place + share * (to.place - from.place), from.turn.slerp(share, to.turn)};
}

ChainAngles ArmTowards(const ChainAngles& angles, const Pose& goal, double turn_weight,
                       const ChainAngles& rest, const ChainAngles& ease) {
  ChainAngles nearer = angles;
  for (int i = 0; i < kArmSolverSteps; ++i) {
    nearer = MuscleArm().Nearer(nearer, goal, turn_weight, rest, ease);
  }
  return nearer;
}

void ArmFollower::Reset() {
  first_ = true;
  sum_.fill(0);
  allocator_.Reset();
}

ArmTorques ArmFollower::WantedTorques(const ArmState& state, const ChainAngles& arm,
                                      const HandAngles& hand) {
  ArmTorques torques = WeightTorques(state);
  ChainAngles angles{};
  std::copy_n(state.angles.begin(), kChainAngles, angles.begin());
  const ChainInertia inertia = MuscleArm().Inertia(angles);
  ChainInertia stiffness = ChainInertia::Zero(), damping = ChainInertia::Zero();
  if (gains_.rate > 0) {
    const ChainInertia moved = inertia + kLeastInertia * ChainInertia::Identity();
    stiffness = gains_.rate * gains_.rate * moved;
    damping = 2 * gains_.damping * gains_.rate * moved;
  }
  Eigen::Matrix<double, kChainAngles, 1> acceleration, missing, slow;
  for (int j = 0; j < kChainAngles; ++j) {
    if (gains_.rate == 0) {
      stiffness(j, j) = gains_.stiffness[j];
      damping(j, j) = 2 * gains_.damping * std::sqrt(gains_.stiffness[j] * inertia(j, j));
    }
    const double speed = first_ ? 0 : (arm[j] - last_arm_[j]) / kArmControlStep;
    acceleration[j] = first_ ? 0
                             : std::clamp((speed - last_speed_[j]) / kArmControlStep,
                                          -kMostAcceleration, kMostAcceleration);
    last_arm_[j] = arm[j];
    last_speed_[j] = speed;
    const double error = arm[j] - angles[j];
    sum_[j] = std::clamp(sum_[j] + gains_.integral * error * kArmControlStep, -kMostIntegral,
                         kMostIntegral);
    missing[j] = error + sum_[j];
    slow[j] = speed - state.velocities[j];
  }
  const Eigen::Matrix<double, kChainAngles, 1> spring = stiffness * missing,
                                               damper = damping * slow;
  const Eigen::Matrix<double, kChainAngles, 1> planned = inertia * acceleration;
  for (int j = 0; j < kChainAngles; ++j) {
    torques[j] += spring[j] + damper[j] + kFriction[j] * state.velocities[j];
    torques[j] += planned[j];
    if (gains_.rate > 0) torques[j] = std::clamp(torques[j], -kMostTorque[j], kMostTorque[j]);
  }
  for (int j = kChainAngles; j < kArmJoints; ++j) {
    torques[j] = gains_.hand_stiffness * (hand[j - kChainAngles] - state.angles[j]) -
                 gains_.hand_damping * state.velocities[j];
  }
  return torques;
}

void ArmFollower::Follow(const ArmAngles& angles, std::span<const double, kArmMuscles> activations,
                         const ChainAngles& arm, const HandAngles& hand,
                         std::span<double, kArmMuscles> excitations) {
  ArmState state;
  state.angles = angles;
  for (int j = 0; j < kArmJoints; ++j) {
    // Differences of angles: the profiles give velocities in different units.
    if (!first_) state.velocities[j] = (angles[j] - last_angles_[j]) / kArmControlStep;
  }
  std::ranges::copy(activations, state.activation.begin());
  last_angles_ = angles;
  ArmTorques weight;
  weight.fill(1);
  std::fill(weight.begin() + kChainAngles, weight.end(), kHandWeight);
  allocator_.Allocate(state, WantedTorques(state, arm, hand), weight, excitations);
  first_ = false;
}

}  // namespace myograde::baseline
