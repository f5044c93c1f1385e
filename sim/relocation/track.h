// Relocation, for the registry: an arm and hand of 63 muscles carry a drawn object into a bin.
#pragma once

#include "sim/track.h"

namespace myograde::sim {

SimulatedTrack SimulatedRelocation();
const ModelSource& RelocationModel();

}  // namespace myograde::sim
