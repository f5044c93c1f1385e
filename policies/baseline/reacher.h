// The controller of the manipulation track's baseline: the muscle arm takes the box from its
// pillar and gives it to the prosthesis, which puts it down on the other one. Hands follow poses
// relative to the box and to the goal, the muscle arm as arm_follower.h says.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <span>

#include "policies/baseline/arm_follower.h"
#include "policies/baseline/chain.h"

namespace myograde::baseline {

inline constexpr size_t kReacherObservation = 222;
inline constexpr size_t kReacherAction = 80;
inline constexpr int kProsthesis = 17;  // servos
inline constexpr int kProsthesisHand = kProsthesis - kChainAngles;

using ProsthesisHand = std::array<double, kProsthesisHand>;  // rad

struct ReacherPlan {
  ArmGains gains;
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
  explicit Reacher(const ReacherPlan& plan) : plan_(plan), follower_(plan.gains) {}

  void Reset();
  // Direct actions: excitations in [0, 1], the prosthesis' targets in rad.
  void Act(std::span<const double, kReacherObservation> observation,
           std::span<double, kReacherAction> action);

 private:
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

  ReacherPlan plan_;
  ArmFollower follower_;
  Phase phase_ = Phase::kBeside;
  double began_ = 0;                         // s, when the phase did
  Eigen::Vector3d box_;                      // m, where it was before the hand came to it
  Pose hand_from_, palm_from_, given_from_;  // where the hands were then
  double grip_from_ = 0, grip_ = 0, take_from_ = 0, take_ = 0;  // 0: open, 1: closed
  ChainAngles arm_{};                                           // targets in rad
  ChainAngles prosthesis_{}, sag_{};                            // targets and corrections in rad
  bool first_ = true;
};

}  // namespace myograde::baseline
