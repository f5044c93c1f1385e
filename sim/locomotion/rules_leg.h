// The prosthetic leg's rules: how much it may do, and the parameter sets that it starts with,
// in the units that people write them in. sim/locomotion/leg.h is the controller.
#pragma once

#include <array>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/policy/leg_parameters.h"

namespace myograde {

// A joint's law: torque = stiffness (target - angle) - damping velocity.
struct JointImpedance {
  double stiffness = 0;   // N m/rad
  double damping = 0;     // N m s/rad
  double target_deg = 0;
};

// What a threshold looks at, in the order of LegStateParameters::threshold.
enum LegQuantity { kLoad, kKneeAngle, kKneeVelocity, kAnkleAngle, kAnkleVelocity };

enum class ThresholdKind : uint8_t { kUnused = 0, kAbove = 1, kBelow = 2 };

// Leaves its state when the quantity is above (below) the value: load in parts of the weight
// of the person, angles in degrees, velocities in degrees/s.
struct LegThreshold {
  ThresholdKind kind = ThresholdKind::kUnused;
  double value = 0;
};

struct LegStateRules {
  JointImpedance knee;
  JointImpedance ankle;
  std::array<LegThreshold, kLegQuantities> until;  // any one suffices; at least one is used
};

struct LegSetRules {
  std::string name;  // for people: what the set is for
  std::array<LegStateRules, kLegStates> states;  // e_stance, l_stance, e_swing, l_swing
};

struct LegRules {
  int sets = 0;               // parameter sets that can be stored and selected, 1 to 5
  // What the sets hold until a policy uploads its own: one entry for each, or none, and then
  // all are the official default.
  std::vector<LegSetRules> parameter_sets;
  bool full_torque = false;   // false: the normalized convention delivers torque / 2.88
  double max_stiffness = 0;   // N m/rad, of any set
  double max_damping = 0;     // N m s/rad, of any set
};

// Parses and checks the "leg" object of a track config's rules; errors as ParseLocomotionRules.
absl::StatusOr<LegRules> ParseLegRules(const nlohmann::json& json, const std::string& where);

}  // namespace myograde
