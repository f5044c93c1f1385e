// The controller of the manipulation track's baseline: the muscle arm takes the box from its
// pillar and gives it to the prosthesis, which puts it down on the other one. Hands follow poses
// relative to the box and to the goal (chain.h); the muscle arm's joints follow by springs, dampers
// and integrals, whose torques its muscles share (arm_muscles.h).
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <span>

#include "policies/baseline/arm_muscles.h"
#include "policies/baseline/chain.h"

namespace myograde::baseline {

inline constexpr size_t kReacherObservation = 222;
inline constexpr size_t kReacherAction = 80;
inline constexpr int kHandJoints = kArmJoints - kChainAngles;  // four of thumb and of each finger
inline constexpr int kProsthesis = 17;                         // servos
inline constexpr int kProsthesisHand = kProsthesis - kChainAngles;

using HandAngles = std::array<double, kHandJoints>;          // rad
using ProsthesisHand = std::array<double, kProsthesisHand>;  // rad

// A pose of a hand: in the world or beside something, as its user says.
struct HandPlan {
  double time = 0;                        // s, that the way there takes
  std::array<double, 3> place{}, turn{};  // m; rotation vector in rad from the arm's nominal pose
};

struct ReacherPlan {
  std::array<double, kChainAngles> stiffness{};  // N m/rad
  double damping = 0;                            // 1: critical
  double integral = 0;                           // 1/s, of the stiffness
  double hand_stiffness = 0;                     // N m/rad
  double hand_damping = 0;                       // N m s/rad
  HandAngles open{}, closed{};
  HandPlan beside, at;             // the muscle hand, from the box's middle
  std::array<double, 3> around{};  // m, how far from the straight way to `beside` its middle is
  double close_time = 0;           // s
  HandPlan lift;                   // from where the hand was; the same turn as `at` and its own
  HandPlan give;                   // the box, in the world
  double take_time = 0;            // s, for the prosthesis to close
  double release_time = 0;         // s, for the muscle hand to open
  HandPlan away;                   // from `give`
  HandPlan offer;                  // the prosthesis, in the world
  ProsthesisHand offered{}, taken{};
  double over = 0, put = 0;       // m, of the box's middle above the goal pillar
  std::array<double, 3> leave{};  // m, from there
  double over_time = 0, put_time = 0, open_time = 0, leave_time = 0;  // s
};

class Reacher {
 public:
  explicit Reacher(const ReacherPlan& plan) : plan_(plan), allocator_(kArmEffort) {}

  void Reset();
  // Direct actions: excitations in [0, 1], the prosthesis' targets in rad.
  void Act(std::span<const double, kReacherObservation> observation,
           std::span<double, kReacherAction> action);

 private:
  static constexpr double kArmEffort = 0.05;  // squared N m for a fully active muscle

  // What is done one after the other. A box that is not lifted is gone for again.
  enum class Phase {
    kBeside,
    kAt,
    kClose,
    kLift,
    kGive,
    kTake,
    kRelease,
    kAway,
    kOver,
    kPut,
    kOpen,
    kLeave
  };

  struct Scene {
    double time = 0;            // s
    Eigen::Vector3d box, goal;  // m: the box's middle, the middle of the pillar's top
    bool on_goal = false;       // the box touches the goal pillar
    ChainAngles arm{}, prosthesis{};
  };

  static Scene SceneOf(std::span<const double, kReacherObservation> observation);
  void Begin(Phase phase, const Scene& scene);
  void Follow(const Scene& scene);  // the next phase, when this one is done
  double Length() const;            // s, of the phase
  Pose HandGoal(const Scene& scene) const;
  Pose PalmGoal(const Scene& scene) const;
  void AimArm(const Scene& scene, double share);
  void AimProsthesis(const Scene& scene, double share);
  ArmTorques WantedTorques(const ArmState& state, ArmTorques& weight);

  ReacherPlan plan_;
  ArmAllocator allocator_;
  Phase phase_ = Phase::kBeside;
  double began_ = 0;                         // s, when the phase did
  Eigen::Vector3d box_;                      // m, where it was before the hand came to it
  Pose hand_from_, palm_from_, given_from_;  // where the hands were then
  double grip_from_ = 0, grip_ = 0, take_from_ = 0, take_ = 0;  // 0: open, 1: closed
  ChainAngles arm_{}, last_arm_{}, last_speed_{};               // targets in rad, rad/s
  ChainAngles sum_{};                                           // rad
  ChainAngles prosthesis_{}, sag_{};                            // targets and corrections in rad
  std::array<double, kArmJoints> last_angles_{};
  bool first_ = true;
};

}  // namespace myograde::baseline
