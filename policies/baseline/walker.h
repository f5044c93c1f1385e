// Walks on the sound leg and the prosthetic one: a machine of two phases (one leg stands, the other
// swings) with springs and dampers around each joint, whose swinging foot is placed by the body's
// place and speed before the standing one. Muscles make the torques (leg_muscles.h); the prosthetic
// leg gets four parameter sets, one for each part of its cycle. With two whole legs both are sound.
#pragma once

#include <array>
#include <span>
#include <string_view>

#include "policies/baseline/leg_muscles.h"
#include "policies/baseline/rotation.h"
#include "policies/baseline/walker_parameters.h"

namespace myograde::baseline {

inline constexpr size_t kWalkerObservation = 365;
inline constexpr size_t kWalkerAction = 55;
inline constexpr size_t kWholeObservation = 393;  // with two whole legs: that of chase-tag

// One impedance of the prosthetic leg: torque = stiffness (target - angle) - damping velocity.
struct LegImpedance {
  double knee_stiffness, knee_damping, knee_target;
  double ankle_stiffness, ankle_damping, ankle_target;
};

inline constexpr int kLegModes = 4;

// What the rule profiles observe differently.
enum class Observed {
  kPaper,     // joint velocities per second; heights 0.2 m apart, from the ground under the body on
  kOfficial,  // `myosuite` and `as-graded`: velocities per control step; heights 0.5 m apart, raw
};

// By the profile's name.
Observed ObservedIn(std::string_view profile);

class Walker {
 public:
  // `begun`: s that the first swing of two whole legs has lasted when an episode begins.
  explicit Walker(const WalkerNumbers& numbers, Legs legs = Legs::kProsthetic, double begun = 0)
      : p_(numbers), legs_(legs), begun_(begun), muscles_(numbers[kEffort], legs) {}

  // What the parameter sets 0 to 3 of the prosthetic leg have to be, in all of their states.
  std::array<LegImpedance, kLegModes> LegModes() const;

  // What the next observations are; kPaper before the first call.
  void Expect(Observed observed) { observed_ = observed; }

  // Before the first observation of an episode.
  void Reset();

  // Fills `action` (muscles from 0 to 1, then the parameter set) for the next observation.
  void Act(std::span<const double, kWalkerObservation> observation,
           std::span<double, kWalkerAction> action);

  // The same for two whole legs, which head for `heading` (rad, from the x axis to the left).
  void Act(std::span<const double, kWholeObservation> observation, double heading,
           std::span<double, kWholeMuscles> action);

 private:
  enum class Side { kLeft, kRight };

  // The body as it moves, in a frame that has its heading: x forwards, y to the left, z up.
  struct Body {
    double pitch, pitch_rate;  // rad and rad/s, forwards
    double roll, roll_rate;    // to the right
    double yaw, yaw_rate;      // from the wanted heading, to the left
    double vx;                 // m/s
    double fast, vy;           // m/s beyond what is wanted, forwards and sideways
    double rise_left, rise_right;  // m, of the ground before the body where each foot lands
    double x_left, y_left;     // m, of the body's middle from the left foot
    double x_right, y_right;
    bool touching_left, touching_right;

    double Rise() const { return (rise_left + rise_right) / 2; }
  };

  // Both feet stay on the ground for a moment after one has landed.
  bool BothStand() const { return !starting_ && since_ < p_[kDoubleTime]; }

  double ControlStep() const { return legs_ == Legs::kWhole ? kWholeControlStep : kControlStep; }
  bool Sound(Side side) const { return legs_ == Legs::kWhole || side == Side::kLeft; }

  void Sense(std::span<const double, kWalkerObservation> observation);
  void Sense(std::span<const double, kWholeObservation> observation, double heading);
  void SenseTrunk(std::span<const double, 4> pelvis, const Vector& velocity, double wanted);
  void SenseGround(std::span<const double, kWalkerObservation> observation);
  void PlaceFeet();
  TorqueGoal Plan();
  void Begin();
  void Advance();
  // `part`: of what the trunk needs.
  void ControlTrunk(Side stance, double part, TorqueGoal& goal) const;
  void ControlSwingHip(Side swing, TorqueGoal& goal) const;
  void Turn(TorqueGoal& goal, int hip, double part, double bias) const;
  void ControlSoundLeg(Side side, TorqueGoal& goal) const;
  int LegMode() const;
  double Lead() const;
  void Pull(TorqueGoal& goal, int joint, double target, double stiffness, double damping,
            double weight) const;

  WalkerNumbers p_;
  Legs legs_;
  double begun_;
  Observed observed_ = Observed::kPaper;
  MuscleAllocator muscles_;
  MuscleState state_;
  std::array<double, kLengthJoints> velocity_{};  // rad/s, of state_.angles
  Body body_{};
  Quaternion last_, tilt_;  // the trunk's in the world, and in the frame that has its heading
  double yaw_ = 0;          // rad, of the trunk in the world
  bool first_ = true;
  bool starting_ = false;  // stands still and leans forwards
  Side swing_ = Side::kRight;
  double since_ = 0;       // s, of the present phase
  double early_ = 0;       // s, by which the prosthesis has landed before its time
  double swing_from_ = 0;  // rad of the swinging thigh when it left the ground, seen from the world
};

}  // namespace myograde::baseline
