// Die reorientation, for the registry: a hand of 39 muscles turns a die on its palm to a drawn
// orientation and place.
#pragma once

#include "sim/track.h"

namespace myograde::sim {

SimulatedTrack SimulatedReorientation();
const ModelSource& ReorientationModel();

}  // namespace myograde::sim
