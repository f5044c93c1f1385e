// Chase-tag, for the registry: a person of 80 muscles chases an opponent or evades it.
#pragma once

#include "sim/track.h"

namespace myograde::sim {

SimulatedTrack SimulatedChaseTag();
const ModelSource& ChaseTagModel();

}  // namespace myograde::sim
