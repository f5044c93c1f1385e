#include "policies/baseline/hand.h"

#include <algorithm>

namespace myograde::baseline {
namespace {

constexpr int kPronation = kArmJoints - kHandAngles;  // of the arm's joints: pronation
constexpr int kWrist = 3;                             // joints before the thumb's
// N m/rad and N m s/rad: of these, and of thumb and fingers.
constexpr double kWristStiffness = 8, kWristDamping = 0.1;
constexpr double kFingerStiffness = 1.5, kFingerDamping = 0.03;
constexpr double kFingerWeight = 20;  // what torques of thumb and fingers matter more

}  // namespace

void Hand::Reset() {
  first_ = true;
  allocator_.Reset();
}

void Hand::Follow(std::span<const double, kHandAngles> angles,
                  std::span<const double, kHandActions> activations, const HandPosture& target,
                  std::span<double, kHandActions> excitations) {
  ArmState state;
  ArmTorques torques{}, weight{};
  std::ranges::copy(activations, state.activation.begin() + kHandMuscle);
  for (int j = 0; j < kHandAngles; ++j) {
    const bool wrist = j < kWrist;
    const int joint = kPronation + j;
    state.angles[joint] = angles[j];
    // Differences of angles, as the observation has no velocities of joints.
    if (!first_) state.velocities[joint] = (angles[j] - last_[j]) / control_step_;
    last_[j] = angles[j];
    torques[joint] = (wrist ? kWristStiffness : kFingerStiffness) * (target[j] - angles[j]) -
                     (wrist ? kWristDamping : kFingerDamping) * state.velocities[joint];
    weight[joint] = wrist ? 1 : kFingerWeight;
  }
  first_ = false;
  std::array<double, kArmMuscles> all{};
  allocator_.Allocate(state, torques, weight, all);
  std::copy_n(all.begin() + kHandMuscle, kHandActions, excitations.begin());
}

}  // namespace myograde::baseline
