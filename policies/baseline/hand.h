// A hand that is led through postures: springs and dampers of its joints, whose torques its muscles
// share (arm_muscles.h). It is the arm's from pronation on.
#pragma once

#include <array>
#include <span>

#include "policies/baseline/arm_muscles.h"

namespace myograde::baseline {

inline constexpr int kHandAngles = 23;  // pronation, two of the wrist, thumb and fingers
inline constexpr int kHandActions = kArmMuscles - kHandMuscle;
inline constexpr double kHandControlStep = 0.025;  // s

using HandPosture = std::array<double, kHandAngles>;  // rad

class Hand {
 public:
  void Reset();

  // Excitations in [0, 1] that draw the joints from `angles` to `target` (rad), by the muscles'
  // present `activations`.
  void Follow(std::span<const double, kHandAngles> angles,
              std::span<const double, kHandActions> activations, const HandPosture& target,
              std::span<double, kHandActions> excitations);

 private:
  static constexpr double kEffort = 0.001;  // squared N m for a fully active muscle

  ArmAllocator allocator_{kEffort, kHandControlStep, kHandMuscle};
  HandPosture last_{};
  bool first_ = true;
};

}  // namespace myograde::baseline
