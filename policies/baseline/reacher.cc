#include "policies/baseline/reacher.h"

#include <algorithm>
#include <cmath>

namespace myograde::baseline {
namespace {

constexpr double kPalmTurnWeight = 0.05;  // m/rad, of the prosthesis
constexpr int kSolverSteps = 4;
constexpr double kSagRate = 1.5;      // 1/s, how fast the servos' sag is made good
constexpr double kMostSag = 0.4;      // rad
constexpr double kSettle = 0.3;       // s more that a way may take
constexpr double kNear = 0.015;       // m
constexpr double kLifted = 0.03;      // m above where it stood
constexpr double kMostInHand = 0.08;  // m, from the grasp point to the middle of a held box
constexpr double kPillar = 1.09;      // m, the tops of both
constexpr double kStanding = 1.134;   // m, the middle of a standing box
constexpr double kHalfDepth = 0.014;  // m, from the box's origin to its middle
constexpr size_t kArmAngles = 1, kProsthesisAngles = 77, kBox = 129, kGoalPlace = 145,
                 kTouching = 148, kArmActivations = 153;
// The posture whose orientation the plan's turns of the prosthesis start from: its palm towards the
// body, its fingers to the right.
constexpr ChainAngles kPalmInFront = {0.85, -0.1, 1.05, 1.2, 0.85, -0.1, 0.4};

Eigen::Quaterniond PalmTurn(const std::array<double, 3>& turn) {
  static const Eigen::Quaterniond nominal = ProstheticArm().Of(kPalmInFront).turn;
  return Turned(turn, nominal);
}

}  // namespace

void Reacher::Reset() {
  first_ = true;
  sag_.fill(0);
  grip_ = take_ = 0;
  follower_.Reset();
}

Reacher::Scene Reacher::SceneOf(std::span<const double, kReacherObservation> observation) {
  Scene scene;
  scene.time = observation[0];
  const Eigen::Map<const Eigen::Vector3d> origin(&observation[kBox]);
  const Eigen::Quaterniond turn(observation[kBox + 3], observation[kBox + 4], observation[kBox + 5],
                                observation[kBox + 6]);
  scene.box = origin + turn * Eigen::Vector3d(0, 0, kHalfDepth);
  scene.goal = {observation[kGoalPlace], observation[kGoalPlace + 1], kPillar};
  scene.on_goal = observation[kTouching + 3] > 0;
  for (int j = 0; j < kChainAngles; ++j) {
    scene.arm[j] = observation[kArmAngles + ModelJoint(j)];
    scene.prosthesis[j] = observation[kProsthesisAngles + j];
  }
  return scene;
}

void Reacher::Begin(Phase phase, const Scene& scene) {
  phase_ = phase;
  began_ = scene.time;
  hand_from_ = MuscleArm().Of(arm_);
  if (phase <= Phase::kAt) box_ = scene.box;
  if (phase == Phase::kAway) given_from_ = hand_from_;
  // Until it carries the box, the prosthesis is on its one way to where it takes it.
  if (first_ || phase >= Phase::kOver) palm_from_ = ProstheticArm().Of(prosthesis_);
  grip_from_ = grip_;
  take_from_ = take_;
}

double Reacher::Length() const {
  switch (phase_) {
    case Phase::kBeside:
      return plan_.beside.time;
    case Phase::kAt:
      return plan_.at.time;
    case Phase::kClose:
      return plan_.close_time;
    case Phase::kLift:
      return plan_.lift.time;
    case Phase::kGive:
      return plan_.give.time;
    case Phase::kTake:
      return plan_.take_time;
    case Phase::kRelease:
      return plan_.release_time;
    case Phase::kAway:
      return plan_.away.time;
    case Phase::kOver:
      return plan_.over_time;
    case Phase::kPut:
      return plan_.put_time;
    case Phase::kOpen:
      return plan_.open_time;
    case Phase::kLeave:
      return plan_.leave_time;
  }
  return 0;
}

Pose Reacher::HandGoal(const Scene& scene) const {
  switch (phase_) {
    case Phase::kBeside:
      return {scene.box + Vec(plan_.beside.place), ArmTurn(plan_.beside.turn)};
    case Phase::kAt:
    case Phase::kClose:
      return {box_ + Vec(plan_.at.place), ArmTurn(plan_.at.turn)};
    case Phase::kLift:
      return {hand_from_.place + Vec(plan_.lift.place), ArmTurn(plan_.lift.turn)};
    case Phase::kGive: {
      // Wherever in the hand the box is, it is the box that goes there.
      const Eigen::Vector3d in_hand = MuscleArm().Of(scene.arm).place - scene.box;
      return {Vec(plan_.give.place) + in_hand * std::min(1.0, kMostInHand / in_hand.norm()),
              ArmTurn(plan_.give.turn)};
    }
    case Phase::kTake:
    case Phase::kRelease:
      return hand_from_;
    default:
      return {given_from_.place + Vec(plan_.away.place), ArmTurn(plan_.away.turn)};
  }
}

void Reacher::Follow(const Scene& scene) {
  const double late = scene.time - began_ - Length();
  if (late < 0) return;
  const bool moves = phase_ == Phase::kBeside || phase_ == Phase::kAt || phase_ == Phase::kGive;
  if (moves && late < kSettle) {
    // The hand is given a little longer to get there.
    const Eigen::Vector3d missing = MuscleArm().Of(scene.arm).place - HandGoal(scene).place;
    if (missing.norm() >= kNear) return;
  }
  switch (phase_) {
    case Phase::kLift:
      return Begin(scene.box.z() > kStanding + kLifted ? Phase::kGive : Phase::kBeside, scene);
    case Phase::kPut:
      if (scene.on_goal || late > 1) Begin(Phase::kOpen, scene);
      return;
    case Phase::kLeave:
      return;
    default:
      return Begin(static_cast<Phase>(static_cast<int>(phase_) + 1), scene);
  }
}

void Reacher::AimArm(const Scene& scene, double share) {
  Pose goal = Between(hand_from_, HandGoal(scene), share);
  if (phase_ == Phase::kBeside) goal.place += 4 * share * (1 - share) * Vec(plan_.around);
  arm_ = ArmTowards(arm_, goal);
  const bool closed = phase_ >= Phase::kClose && phase_ < Phase::kRelease;
  grip_ = Mixed(grip_from_, closed ? 1 : 0, share);
}

Pose Reacher::PalmGoal(const Scene& scene) const {
  switch (phase_) {
    case Phase::kOver:
    case Phase::kPut: {
      // Wherever in the palm the box is, it is the box that goes there.
      const double height = phase_ == Phase::kOver ? plan_.over : plan_.put;
      const Eigen::Vector3d in_palm = ProstheticArm().Of(scene.prosthesis).place - scene.box;
      return {scene.goal + Eigen::Vector3d(0, 0, height) + in_palm, palm_from_.turn};
    }
    case Phase::kOpen:
      return palm_from_;
    case Phase::kLeave:
      return {palm_from_.place + Vec(plan_.leave), palm_from_.turn};
    default:
      return {Vec(plan_.offer.place), PalmTurn(plan_.offer.turn)};
  }
}

void Reacher::AimProsthesis(const Scene& scene, double share) {
  const double way = phase_ < Phase::kOver ? Smooth(scene.time / plan_.offer.time) : share;
  const Pose goal = Between(palm_from_, PalmGoal(scene), way);
  for (int i = 0; i < kSolverSteps; ++i) {
    prosthesis_ = ProstheticArm().Nearer(prosthesis_, goal, kPalmTurnWeight, kPalmInFront);
  }
  for (int j = 0; j < kChainAngles; ++j) {
    sag_[j] =
        std::clamp(sag_[j] + kSagRate * kArmControlStep * (prosthesis_[j] - scene.prosthesis[j]),
                   -kMostSag, kMostSag);
  }
  const bool taken = phase_ >= Phase::kTake && phase_ < Phase::kOpen;
  take_ = Mixed(take_from_, taken ? 1 : 0, share);
}

void Reacher::Act(std::span<const double, kReacherObservation> observation,
                  std::span<double, kReacherAction> action) {
  ArmAngles angles;
  for (int j = 0; j < kArmJoints; ++j) angles[j] = observation[kArmAngles + ModelJoint(j)];
  Scene scene = SceneOf(observation);
  if (first_) {
    arm_ = scene.arm;
    prosthesis_ = scene.prosthesis;
    Begin(Phase::kBeside, scene);
  }
  Follow(scene);
  const double share = Smooth((scene.time - began_) / std::max(Length(), kArmControlStep));
  AimArm(scene, share);
  AimProsthesis(scene, share);
  HandAngles hand;
  for (int j = 0; j < kHandJoints; ++j) hand[j] = Mixed(plan_.open[j], plan_.closed[j], grip_);
  follower_.Follow(angles, observation.subspan<kArmActivations, kArmMuscles>(), arm_, hand,
                   action.first<kArmMuscles>());
  for (int j = 0; j < kChainAngles; ++j) action[kArmMuscles + j] = prosthesis_[j] + sag_[j];
  for (int j = 0; j < kProsthesisHand; ++j) {
    action[kArmMuscles + kChainAngles + j] = Mixed(plan_.offered[j], plan_.taken[j], take_);
  }
  first_ = false;
}

}  // namespace myograde::baseline
