// What the elbow's model is compiled from, beside the pins in elbow.sha256. Nothing in its files
// needs a patch, and no body that moves gets its mass from a mesh (README.md has the comparison).
#pragma once

namespace myograde::sim {

// In the package.
inline constexpr char kElbowMainFile[] = "envs/myo/assets/elbow/myoelbow_1dof6muscles.xml";
inline constexpr char kElbowActuatorFile[] =
    "simhive/myo_sim/elbow/assets/myoelbow_1dof6muscles_body.xml";

// Buffers of mjData. In play the arm touches nothing, the only constraint is the joint's stop, and
// the stack holds 60 numbers: these are many times of that, and still small.
inline constexpr int kElbowConstraints = 200;
inline constexpr int kElbowContacts = 50;
inline constexpr int kElbowStack = 200'000;  // doubles

}  // namespace myograde::sim
