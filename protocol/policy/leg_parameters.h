// A prosthetic leg's parameter sets, as policies upload them and its track uses them. On the way they are
// the track's parameters, a JSON object (protocol/bridge/leg_sets_json.h).
#pragma once

#include <array>
#include <cstdint>

namespace myograde {

inline constexpr int kLegSets = 5;
inline constexpr int kLegStates = 4;      // e_stance, l_stance, e_swing, l_swing
// Their JSON keys, in the same order.
inline constexpr std::array<const char*, kLegStates> kLegStateKeys = {"e_stance", "l_stance",
                                                                      "e_swing", "l_swing"};
inline constexpr int kLegQuantities = 5;  // load, knee_angle, knee_vel, ankle_angle, ankle_vel

// One state of the leg's impedance controller. Units: N m/rad, N m s/rad, rad. The controller
// leaves the state when any threshold is met: its quantity is above (or below) its value. Loads in
// N, angles in rad, velocities in rad/s.
struct LegStateParameters {
  double knee_stiffness, knee_damping, knee_target;
  double ankle_stiffness, ankle_damping, ankle_target;
  double threshold[kLegQuantities];
  // 0 unused, 1 leaves when above, 2 leaves when below.
  uint8_t threshold_kind[kLegQuantities];
};

struct LegParameterSets {
  uint32_t present;  // bit i: set i was uploaded
  LegStateParameters set[kLegSets][kLegStates];
};

}  // namespace myograde
