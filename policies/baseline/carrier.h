// The controller of the relocation track's baseline: the hand comes to the object, closes around
// it, carries it over the bin and lets go. It follows poses relative to the object and to the goal
// (arm_follower.h), one after the other by the clock, as an episode lasts only 1.5 s.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <span>

#include "policies/baseline/arm_follower.h"
#include "policies/baseline/chain.h"

namespace myograde::baseline {

inline constexpr size_t kCarrierObservation = 156;

struct CarrierPlan {
  ArmGains gains;
  ChainAngles rest{};  // rad, where what the hand's pose leaves free goes
  double ease = 1;  // of the shoulder's first two angles, which much inertia makes slow (chain.h)
  HandAngles open{}, closed{};  // until the object is in the hand
  HandAngles freed{};           // when it is to fall
  double yaw = 0;               // rad that the hand turns for 1 rad of the object's bearing
  HandPlan beside, at;          // from the object
  double close_time = 0;        // s
  HandPlan over;                // the object's place, from the goal
  double turn_weight = 0;       // m/rad, until the object is in the hand
  double over_turn_weight = 0;  // m/rad, from then on
  double rise = 0, lag = 0;     // shares of the way over: when it is up, when it goes sideways
  double correction = 0;        // 1/s, of where the hand is on the way over
  double aim = 0;               // m from the bin's axis, where the hand opens ...
  double let_go = 0;            // ... this long before the object is there, in s
  double open_time = 0;         // s
};

class Carrier {
 public:
  explicit Carrier(const CarrierPlan& plan) : plan_(plan), follower_(plan.gains) {}

  void Reset();
  // Direct actions: excitations in [0, 1].
  void Act(std::span<const double, kCarrierObservation> observation,
           std::span<double, kArmMuscles> action);

 private:
  enum class Phase { kBeside, kAt, kClose, kOver };

  struct Scene {
    ChainAngles arm{};              // rad
    Eigen::Vector3d object, speed;  // m, m/s
  };

  double Elapsed() const { return (steps_ - began_) * kArmControlStep; }  // s, of the phase
  double Length() const;                                                  // s, of the phase
  const HandPlan& Way() const;                                            // of the phase
  void Begin(Phase phase);
  void Follow(const Scene& scene);  // the next phase, when this one is done
  // Whether the object will be over the bin once the hand is open.
  bool WillBeOverBin(const Scene& scene) const;
  Pose Goal() const;                      // of the hand
  void Aim(const Eigen::Vector3d& hand);  // `hand`: m, where it is

  CarrierPlan plan_;
  ArmFollower follower_;
  Phase phase_ = Phase::kBeside;
  int steps_ = 0, began_ = 0;      // observations so far; when the phase began
  int opened_ = 0;                 // when the hand began to open; 0: not yet
  Eigen::Vector3d object_, goal_;  // m: where the hand goes for; the middle of the bin's floor
  Eigen::Vector3d last_object_ = Eigen::Vector3d::Zero();  // m
  Eigen::Vector3d in_hand_;                                // m, from the object to the hand
  Eigen::Vector3d beyond_;           // m, from where the hand should be to where it is aimed
  Pose from_;                        // where the hand was aimed at when the phase began
  double grip_from_ = 0, grip_ = 0;  // 0: open, 1: closed
  ChainAngles arm_{};                // targets in rad
};

}  // namespace myograde::baseline
