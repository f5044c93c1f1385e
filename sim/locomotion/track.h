// Locomotion, for the registry: a person with a prosthetic leg walks a course of 100 m.
#pragma once

#include "sim/track.h"

namespace myograde::sim {

SimulatedTrack SimulatedLocomotion();
const ModelSource& LocomotionModel();

}  // namespace myograde::sim
