// Baoding balls, for the registry: a hand of 39 muscles moves two balls on its palm after two
// targets that circle each other.
#pragma once

#include "sim/track.h"

namespace myograde::sim {

SimulatedTrack SimulatedBaoding();
const ModelSource& BaodingModel();

}  // namespace myograde::sim
