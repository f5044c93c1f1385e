// The muscles of the arm, as a policy can know them: what each could pull in the present posture,
// around which joints, and which activations give wanted torques. Lengths come from polynomials
// (length_terms.h), for the observation has none.
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "policies/baseline/length_terms.h"

namespace myograde::baseline {

inline constexpr int kArmMuscles = 63;
inline constexpr int kHandMuscle = 24;  // the first that the forearm and the hand have
// The independent joints: elevation plane, elevation and rotation of the shoulder, elbow,
// pronation, two of the wrist, four of the thumb and four of each finger.
inline constexpr int kArmJoints = 27;
inline constexpr double kArmControlStep = 0.01;  // s

using ArmTorques = std::array<double, kArmJoints>;  // N m

struct ArmState {
  std::array<double, kArmJoints> angles{};       // rad
  std::array<double, kArmJoints> velocities{};   // rad/s
  std::array<double, kArmMuscles> activation{};  // 0 to 1, in the order of the action
};

// What carries the arm's own weight at each joint; the hand's own joints are left out.
ArmTorques WeightTorques(const ArmState& state);

// What the muscles' present activations make of torque around each joint.
ArmTorques MuscleTorques(const ArmState& state);

// Turns wanted torques into excitations, step by step: it remembers its last answer, which the next
// search starts from.
class ArmAllocator {
 public:
  // `effort`: what a squared activation costs, in squared N m of missed torque. `control_step` in
  // s. The muscles before `first` are not there: a hand alone has only those from kHandMuscle on.
  explicit ArmAllocator(double effort, double control_step = kArmControlStep, int first = 0)
      : effort_(effort), control_step_(control_step), first_(first) {}

  void Reset() { last_.fill(0); }

  // Excitations in [0, 1] that bring the activations, within a control step and as far as the
  // muscles' own delay lets them, to where they make the torques of `goal`, each of which matters
  // as `weight` says.
  void Allocate(const ArmState& state, const ArmTorques& goal, const ArmTorques& weight,
                std::span<double, kArmMuscles> excitations);

 private:
  double effort_, control_step_;
  int first_;
  std::array<double, kArmMuscles> last_{};
};

}  // namespace myograde::baseline
