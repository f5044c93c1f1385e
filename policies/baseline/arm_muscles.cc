#include "policies/baseline/arm_muscles.h"

#include <algorithm>
#include <vector>

#include "policies/baseline/muscle_curves.h"
#include "policies/baseline/share_torques.h"

namespace myograde::baseline {
namespace {

constexpr int kArmSweeps = 12;  // of the coordinate descent

struct ArmEntry {
  const char* name;
  std::vector<int> joints;
  MuscleParameters parameters;
  double constant;  // m
  std::vector<double> weights;
};

struct ArmMuscle {
  LengthTerms terms;
  MuscleParameters parameters;
  double constant;
  std::vector<double> weights;
};

// The muscles, and the potential energy behind them.
const std::vector<ArmMuscle>& ArmTable() {
  static const std::vector<ArmMuscle> muscles = [] {
    const std::vector<ArmEntry> entries = {
#include "policies/baseline/arm_muscles.inc"
    };
    std::vector<ArmMuscle> out;
    for (const ArmEntry& entry : entries) {
      out.push_back({LengthTerms(entry.joints), entry.parameters, entry.constant, entry.weights});
    }
    return out;
  }();
  return muscles;
}

using Arms = std::array<double, kMostJoints>;

Arms ArmsOf(const ArmMuscle& muscle, const ArmState& state) {
  Arms arms{};
  muscle.terms.AddSlopes(muscle.weights, state.angles, arms);
  return arms;
}

MusclePull PullNow(const ArmMuscle& muscle, const Arms& arms, const ArmState& state) {
  double velocity = 0;
  for (int j = 0; j < muscle.terms.joints(); ++j) {
    velocity += arms[j] * state.velocities[muscle.terms.joint(j)];
  }
  return PullOf(muscle.parameters,
                muscle.constant + muscle.terms.Value(muscle.weights, state.angles), velocity);
}

}  // namespace

ArmTorques WeightTorques(const ArmState& state) {
  ArmTorques torques{};
  const ArmMuscle& weight = ArmTable()[kArmMuscles];
  const Arms slopes = ArmsOf(weight, state);
  for (int j = 0; j < weight.terms.joints(); ++j) torques[weight.terms.joint(j)] = slopes[j];
  return torques;
}

ArmTorques MuscleTorques(const ArmState& state) {
  ArmTorques torques{};
  for (int i = 0; i < kArmMuscles; ++i) {
    const ArmMuscle& muscle = ArmTable()[i];
    const Arms arms = ArmsOf(muscle, state);
    const MusclePull pull = PullNow(muscle, arms, state);
    for (int j = 0; j < muscle.terms.joints(); ++j) {
      torques[muscle.terms.joint(j)] -=
          arms[j] * (pull.active * state.activation[i] + pull.passive);
    }
  }
  return torques;
}

void ArmAllocator::Allocate(const ArmState& state, const ArmTorques& goal, const ArmTorques& weight,
                            std::span<double, kArmMuscles> excitations) {
  // Torque of each muscle at full activation, and what is missing of the goal.
  std::array<Arms, kArmMuscles> torque{};
  ArmTorques missing = goal;
  std::array<ActivationBounds, kArmMuscles> bounds{};
  const std::vector<ArmMuscle>& muscles = ArmTable();
  for (int i = first_; i < kArmMuscles; ++i) {
    const ArmMuscle& muscle = muscles[i];
    const Arms arms = ArmsOf(muscle, state);
    const MusclePull pull = PullNow(muscle, arms, state);
    bounds[i] = Reachable(state.activation[i], control_step_);
    last_[i] = std::clamp(last_[i], bounds[i].low, bounds[i].high);
    for (int j = 0; j < muscle.terms.joints(); ++j) {
      torque[i][j] = -arms[j] * pull.active;
      missing[muscle.terms.joint(j)] += arms[j] * pull.passive - torque[i][j] * last_[i];
    }
  }
  ShareTorques(muscles, torque, bounds, weight, effort_, kArmSweeps, missing, last_);
  for (int i = 0; i < kArmMuscles; ++i) {
    excitations[i] = Excitation(state.activation[i], last_[i], control_step_);
  }
}

}  // namespace myograde::baseline
