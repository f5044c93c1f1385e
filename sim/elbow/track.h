// The elbow, for the registry: six muscles bring an elbow to a drawn angle and hold it there.
#pragma once

#include "sim/track.h"

namespace myograde::sim {

SimulatedTrack SimulatedElbow();
const ModelSource& ElbowModel();

}  // namespace myograde::sim
