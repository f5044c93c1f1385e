#include "policies/baseline/carrier.h"

#include <algorithm>
#include <cmath>

namespace myograde::baseline {
namespace {

constexpr size_t kObject = 75, kBinFloor = 78, kCarrierActivations = 93;
constexpr double kMostHeld = 0.1;     // m, from the grasp point to the middle of a held object
constexpr double kMostBeyond = 0.15;  // m
constexpr double kWall = 0.2;         // m, from the goal to the top of the bin's walls
const Eigen::Vector2d kShoulder = {-0.2, 0.1};  // m

// Of a place as the shoulder sees it, in rad: 0 straight ahead.
double Bearing(const Eigen::Vector3d& place) {
  const Eigen::Vector2d way = place.head<2>() - kShoulder;
  return std::atan2(way.x(), -way.y());
}

}  // namespace

void Carrier::Reset() {
  steps_ = opened_ = 0;
  grip_ = 0;
  follower_.Reset();
}

const HandPlan& Carrier::Way() const {
  if (phase_ == Phase::kBeside) return plan_.beside;
  return phase_ == Phase::kOver ? plan_.over : plan_.at;
}

double Carrier::Length() const { return phase_ == Phase::kClose ? plan_.close_time : Way().time; }

void Carrier::Begin(Phase phase) {
  phase_ = phase;
  began_ = steps_;
  from_ = MuscleArm().Of(arm_);
  grip_from_ = grip_;
  beyond_.setZero();
}

Pose Carrier::Goal() const {
  const HandPlan& plan = Way();
  const bool over = phase_ == Phase::kOver;
  const Eigen::Vector3d place = Vec(plan.place) + (over ? goal_ : object_);
  const Eigen::AngleAxisd yaw(plan_.yaw * Bearing(over ? place : object_),
                              Eigen::Vector3d::UnitZ());
  return {over ? place + in_hand_ : place, Eigen::Quaterniond(yaw * ArmTurn(plan.turn))};
}

void Carrier::Aim(const Eigen::Vector3d& hand) {
  const double t = Elapsed() / std::max(Length(), kArmControlStep);
  const Pose goal = Goal();
  Pose next = Between(from_, goal, Smooth(t));
  if (phase_ == Phase::kOver) {
    // Up first, so that the object clears the bin's wall.
    const Eigen::Vector3d way = goal.place - from_.place;
    const double up = Smooth(t / plan_.rise), aside = Smooth((t - plan_.lag) / (1 - plan_.lag));
    next.place = from_.place + way.cwiseProduct(Eigen::Vector3d(aside, aside, up));
    // What the arm keeps missing is aimed beyond.
    beyond_ += plan_.correction * kArmControlStep * (next.place - hand);
    beyond_ *= std::min(1.0, kMostBeyond / std::max(beyond_.norm(), kMostBeyond));
    next.place += beyond_;
  }
  const double turn_weight = phase_ < Phase::kOver ? plan_.turn_weight : plan_.over_turn_weight;
  arm_ = ArmTowards(arm_, next, turn_weight, plan_.rest, {plan_.ease, plan_.ease, 1, 1, 1, 1, 1});
  grip_ = opened_ > 0 ? 1 - Smooth((steps_ - opened_) * kArmControlStep / plan_.open_time)
                      : Mixed(grip_from_, phase_ >= Phase::kClose ? 1 : 0, Smooth(t));
}

bool Carrier::WillBeOverBin(const Scene& scene) const {
  const Eigen::Vector3d missing = scene.object + plan_.let_go * scene.speed - goal_;
  return missing.z() > kWall && missing.head<2>().norm() < plan_.aim;
}

void Carrier::Follow(const Scene& scene) {
  if (phase_ == Phase::kOver) {
    if (opened_ == 0 && WillBeOverBin(scene)) opened_ = steps_;
    return;
  }
  if (Elapsed() < Length()) return;
  Begin(static_cast<Phase>(static_cast<int>(phase_) + 1));
  if (phase_ == Phase::kOver) {
    in_hand_ = MuscleArm().Of(scene.arm).place - scene.object;
    in_hand_ *= std::min(1.0, kMostHeld / in_hand_.norm());
  }
}

void Carrier::Act(std::span<const double, kCarrierObservation> observation,
                  std::span<double, kArmMuscles> action) {
  ArmAngles angles;
  // The last joint of the little finger is not observed: it is taken to be like the ring finger's.
  constexpr int kLast = kArmJoints - 1, kRing = kLast - 4;
  for (int j = 0; j < kArmJoints; ++j) angles[j] = observation[ModelJoint(j == kLast ? kRing : j)];
  Scene scene;
  std::copy_n(angles.begin(), kChainAngles, scene.arm.begin());
  scene.object = Eigen::Map<const Eigen::Vector3d>(&observation[kObject]);
  scene.speed = (scene.object - last_object_) / kArmControlStep;
  last_object_ = scene.object;
  goal_ = Eigen::Map<const Eigen::Vector3d>(&observation[kBinFloor]);
  // The first observation may show another object and goal than there are: the arm waits.
  if (steps_ == 0) arm_ = scene.arm;
  if (steps_ == 1) Begin(Phase::kBeside);
  if (steps_ > 0) {
    if (phase_ <= Phase::kAt) object_ = scene.object;
    Follow(scene);
    Aim(MuscleArm().Of(scene.arm).place);
  }
  HandAngles hand;
  const HandAngles& open = opened_ > 0 ? plan_.freed : plan_.open;
  for (int j = 0; j < kHandJoints; ++j) hand[j] = Mixed(open[j], plan_.closed[j], grip_);
  follower_.Follow(angles, observation.subspan<kCarrierActivations, kArmMuscles>(), arm_, hand,
                   action);
  ++steps_;
}

}  // namespace myograde::baseline
