// What a replay of the manipulation track shows besides the bodies.
#pragma once

#include <memory>

#include "sim/trajectory/telemetry.h"

namespace myograde::sim {

// REQUIRES: an environment of MakeManipulation, which outlives the telemetry.
std::unique_ptr<Telemetry> WatchManipulation(const Environment& environment);

}  // namespace myograde::sim
