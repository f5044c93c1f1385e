// The elbow's model.
#pragma once

#include "sim/model/source.h"

namespace myograde::sim {

const ModelSource& ElbowModel();

}  // namespace myograde::sim
