// How the muscle arm follows targets: the hand's poses by inverse kinematics (chain.h), the joints
// by springs, dampers and integrals, whose torques the muscles share (arm_muscles.h).
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <span>

#include "policies/baseline/arm_muscles.h"
#include "policies/baseline/chain.h"

namespace myograde::baseline {

inline constexpr int kHandJoints = kArmJoints - kChainAngles;  // four of thumb and of each finger

using ArmAngles = std::array<double, kArmJoints>;    // rad
using HandAngles = std::array<double, kHandJoints>;  // rad

// A pose of a hand: in the world or beside something, as its user says.
struct HandPlan {
  double time = 0;                        // s, that the way there takes
  std::array<double, 3> place{}, turn{};  // m; rotation vector in rad from the arm's nominal pose
};

struct ArmGains {
  ChainAngles stiffness{};    // N m/rad; instead of which, unless it is 0:
  double rate = 0;            // 1/s, at which the arm as a whole swings by its springs
  double damping = 0;         // 1: critical
  double integral = 0;        // 1/s, of the stiffness
  double hand_stiffness = 0;  // N m/rad
  double hand_damping = 0;    // N m s/rad
};

// Where the independent joint `joint` stands among the model's 38.
size_t ModelJoint(int joint);

// A way from 0 to 1 without jumps of its acceleration.
double Smooth(double x);

inline double Mixed(double from, double to, double share) { return from + share * (to - from); }

Eigen::Vector3d Vec(const std::array<double, 3>& v);

Eigen::Quaterniond Turned(const std::array<double, 3>& turn, const Eigen::Quaterniond& nominal);

// The muscle hand, turned from its nominal pose: beside a thing, its palm to the left.
Eigen::Quaterniond ArmTurn(const std::array<double, 3>& turn);

Pose Between(const Pose& from, const Pose& to, double share);

inline constexpr double kHandTurnWeight = 0.12;  // m/rad
// The posture whose orientation the plans' turns start from: the palm beside a thing.
inline constexpr ChainAngles kPalmBeside = {0.63, 0.72, -0.46, 0.77, 0.44, 0.19, 0.7};

// The muscle arm's angles nearer to `goal` than `angles`, as Chain::Nearer says.
ChainAngles ArmTowards(const ChainAngles& angles, const Pose& goal,
                       double turn_weight = kHandTurnWeight, const ChainAngles& rest = kPalmBeside,
                       const ChainAngles& ease = kAllEasy);

class ArmFollower {
 public:
  explicit ArmFollower(const ArmGains& gains) : gains_(gains), allocator_(kEffort) {}

  void Reset();

  // Excitations in [0, 1] that lead the joints, now at `angles`, to `arm` and `hand`, by the
  // muscles' present `activations`.
  void Follow(const ArmAngles& angles, std::span<const double, kArmMuscles> activations,
              const ChainAngles& arm, const HandAngles& hand,
              std::span<double, kArmMuscles> excitations);

 private:
  static constexpr double kEffort = 0.05;  // squared N m for a fully active muscle

  ArmTorques WantedTorques(const ArmState& state, const ChainAngles& arm, const HandAngles& hand);

  ArmGains gains_;
  ArmAllocator allocator_;
  ChainAngles last_arm_{}, last_speed_{};  // targets in rad, rad/s
  ChainAngles sum_{};                      // rad
  ArmAngles last_angles_{};
  bool first_ = true;
};

}  // namespace myograde::baseline
