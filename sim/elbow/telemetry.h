// What a replay of the elbow track shows besides the bodies.
#pragma once

#include <memory>

#include "sim/trajectory/telemetry.h"

namespace myograde::sim {

// REQUIRES: an environment of MakeElbow, which outlives the telemetry.
std::unique_ptr<Telemetry> WatchElbow(const Environment& environment);

}  // namespace myograde::sim
