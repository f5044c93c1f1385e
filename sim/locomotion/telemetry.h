// What a replay of the locomotion track shows besides the bodies.
#pragma once

#include <memory>

#include "sim/trajectory/telemetry.h"

namespace myograde::sim {

// REQUIRES: an environment of MakeLocomotion, which outlives the telemetry.
std::unique_ptr<Telemetry> WatchLocomotion(const Environment& environment);

}  // namespace myograde::sim
