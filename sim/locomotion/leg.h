// The controller of the Open-Source Leg: a machine of four states (early and
// late stance, early and late swing), each with an impedance law for knee and
// ankle and with conditions that leave it for the next. One update for each
// control step.
#pragma once

#include <array>
#include <numbers>

#include <absl/status/status.h>

#include "protocol/bridge/frames.h"
#include "sim/locomotion/rules.h"

namespace myograde::sim {

constexpr double Radians(double degrees) { return degrees * (std::numbers::pi / 180.0); }

enum class LegState { kEarlyStance = 0, kLateStance = 1, kEarlySwing = 2, kLateSwing = 3 };

// What the leg senses, in the order of LegStateParameters::threshold.
struct LegSensors {
  double load = 0;         // N, positive when the foot is loaded
  double knee_angle = 0;   // rad
  double knee_velocity = 0;   // rad/s
  double ankle_angle = 0;
  double ankle_velocity = 0;
};

struct LegTorques {
  double knee = 0;   // N m
  double ankle = 0;
};

// Gears and limit of the leg's motors as the model has them: joint torque is
// gear times control, and the controls are limited to +-kLegMotorLimit.
inline constexpr double kLegKneeGear = 49.4;
inline constexpr double kLegAnkleGear = 58.4;
inline constexpr double kLegMotorLimit = 2.88;

// The model's ranges of the leg's joints, rad.
inline constexpr double kLegKneeLow = 0;
inline constexpr double kLegKneeHigh = 2.0944;
inline constexpr double kLegAnkleLow = -0.5236;
inline constexpr double kLegAnkleHigh = 0.5236;

using LegSet = std::array<LegStateParameters, kLegStates>;

// The parameters of the official controller, which every set starts with where the rules have
// none of their own.
const LegSet& DefaultLegSet();

// A set of the rules in the controller's units: radians, and newtons of load.
LegSet MakeLegSet(const LegSetRules& rules);

class LegController {
 public:
  // Every set starts as the default.
  LegController();
  // The sets start as the rules say.
  explicit LegController(const LegRules& rules);

  // All sets are what they start as, set 0 is selected, the state is early stance.
  void Reset();

  // Checks and stores the sets that are present. All or nothing; an error names
  // the set, the state, the number and what it must be. A stored set acts when
  // it is next selected.
  absl::Status Upload(const LegParameterSets& sets, const LegRules& rules);

  // Makes `set` the acting one; the state stays. REQUIRES: 0 <= set < kLegSets.
  void Select(int set);

  // At most one transition, then torques by the law of the state reached.
  LegTorques Update(const LegSensors& sensors);

  void set_state(LegState state) { state_ = state; }
  LegState state() const { return state_; }
  int selected() const { return selected_; }

 private:
  std::array<LegSet, kLegSets> first_sets_;
  std::array<LegSet, kLegSets> sets_;
  LegSet acting_;
  int selected_ = 0;
  LegState state_ = LegState::kEarlyStance;
};

// "e_stance", "l_stance", "e_swing", "l_swing".
const char* LegStateName(LegState state);

}  // namespace myograde::sim
