// The arm, the prosthesis and the object.
#pragma once

#include "sim/model/source.h"

namespace myograde::sim {

const ModelSource& ManipulationModel();

}  // namespace myograde::sim
