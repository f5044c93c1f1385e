// The elbow's model.
#pragma once

#include "sim/model/source.h"
#include "sim/render/camera_view.h"

namespace myograde::sim {

const ModelSource& ElbowModel();

// From the front right, at the right arm.
const CameraView& ElbowView();

}  // namespace myograde::sim
