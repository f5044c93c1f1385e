// The parameter sets of a prosthetic leg, as a policy uploads them and the simulator takes them.
// Plain data: they cross between processes as they are.
#pragma once

#include <array>
#include <cstdint>

namespace myograde {

inline constexpr int kLegSets = 5;
inline constexpr int kLegStates = 4;      // e_stance, l_stance, e_swing, l_swing
// Their keys in JSON, in their order.
inline constexpr std::array<const char*, kLegStates> kLegStateKeys = {"e_stance", "l_stance",
                                                                      "e_swing", "l_swing"};
inline constexpr int kLegQuantities = 5;  // load, knee_angle, knee_vel, ankle_angle, ankle_vel

// One state of the leg's impedance machine. Units: N m/rad, N m s/rad, rad.
// A threshold leaves the state when the quantity is above (below) its value;
// any one suffices. Loads in N, angles in rad, velocities in rad/s.
struct LegStateParameters {
  double knee_stiffness, knee_damping, knee_target;
  double ankle_stiffness, ankle_damping, ankle_target;
  double threshold[kLegQuantities];
  // 0 unused, 1 leaves when above, 2 leaves when below.
  uint8_t threshold_kind[kLegQuantities];
  uint8_t padding[3];
};

struct LegParameterSets {
  uint32_t present;  // bit i: set i was uploaded
  uint32_t padding;
  LegStateParameters set[kLegSets][kLegStates];
};

}  // namespace myograde
