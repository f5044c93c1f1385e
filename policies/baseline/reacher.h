// The controller of the manipulation track's baseline: both arms follow way points in time, which
// depend on where the box stands and on where it has to go. The muscle arm follows by springs,
// dampers and integrals around its joints, whose torques its muscles share (arm_muscles.h).
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "policies/baseline/arm_muscles.h"

namespace myograde::baseline {

inline constexpr size_t kReacherObservation = 222;
inline constexpr size_t kReacherAction = 80;
inline constexpr int kCarrying = 7;     // joints of shoulder, elbow, forearm and wrist
inline constexpr int kProsthesis = 17;  // servos
inline constexpr int kPlaces = 5;       // 1, and x and y of start and goal beside their middles

struct WayPoint {
  double time = 0;  // s, when it is reached
  double grip = 0;  // 0: the hand is open, 1: closed
  // Angles in rad, each the sum of its row times (1, start x, start y, goal x, goal y).
  std::array<std::array<double, kPlaces>, kCarrying> arm{};
  std::array<double, kProsthesis> prosthesis{};  // rad
};

struct ReacherPlan {
  std::array<double, kCarrying> stiffness{};                    // N m/rad
  std::array<double, kCarrying> damping{};                      // N m s/rad
  std::array<double, kCarrying> integral{};                     // N m/(rad s)
  double hand_stiffness = 0;                                    // N m/rad
  double hand_damping = 0;                                      // N m s/rad
  std::array<double, kArmJoints - kCarrying> open{}, closed{};  // rad
  std::vector<WayPoint> way;  // in the order of their times; at least one
};

class Reacher {
 public:
  explicit Reacher(ReacherPlan plan);

  void Reset();
  // Direct actions: excitations in [0, 1], the prosthesis' targets in rad.
  void Act(std::span<const double, kReacherObservation> observation,
           std::span<double, kReacherAction> action);

 private:
  ReacherPlan plan_;
  ArmAllocator allocator_;
  std::array<double, kPlaces> places_{};
  std::array<double, kArmJoints> last_angles_{};
  std::array<double, kCarrying> last_target_{}, sum_{};
  std::array<double, kCarrying> first_angles_{};
  std::array<double, kProsthesis> first_prosthesis_{};
  bool first_ = true;
};

}  // namespace myograde::baseline
