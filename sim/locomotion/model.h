// The body with the prosthetic leg, and the course.
#pragma once

#include "sim/model/source.h"

namespace myograde::sim {

const ModelSource& LocomotionModel();

}  // namespace myograde::sim
