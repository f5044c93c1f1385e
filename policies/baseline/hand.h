// A hand that is led through postures: springs and dampers of its joints, whose torques its muscles
// share (arm_muscles.h). It is the arm's from pronation on.
#pragma once

#include <array>
#include <span>

#include "policies/baseline/arm_muscles.h"

namespace myograde::baseline {

inline constexpr int kHandAngles = 23;  // pronation, two of the wrist, thumb and fingers
inline constexpr int kHandActions = kArmMuscles - kHandMuscle;

using HandPosture = std::array<double, kHandAngles>;  // rad

// A cupped hand, its palm up.
inline constexpr HandPosture kCuppedHand = {-1.57, 0,   0,   0.3, 0.2, 0,   0,   0.3,
                                            0,     0.5, 0.5, 0.3, 0,   0.5, 0.5, 0.3,
                                            0,     0.5, 0.5, 0.3, 0,   0.5, 0.5};

// Joints that move together: one, and those from `second` on by a share of its angle.
struct JointGroup {
  const char* name;
  int first;
  int second = 0, end = 0;
  double share = 0;

  void Move(double angle, HandPosture& posture) const {  // rad
    posture[first] += angle;
    for (int j = second; j < end; ++j) posture[j] += share * angle;
  }
};

class Hand {
 public:
  explicit Hand(double control_step)  // s
      : control_step_(control_step), allocator_(kEffort, control_step, kHandMuscle) {}

  void Reset();

  // Excitations in [0, 1] that draw the joints from `angles` to `target` (rad), by the muscles'
  // present `activations`.
  void Follow(std::span<const double, kHandAngles> angles,
              std::span<const double, kHandActions> activations, const HandPosture& target,
              std::span<double, kHandActions> excitations);

 private:
  static constexpr double kEffort = 0.001;  // squared N m for a fully active muscle

  double control_step_;
  ArmAllocator allocator_;
  HandPosture last_{};
  bool first_ = true;
};

}  // namespace myograde::baseline
