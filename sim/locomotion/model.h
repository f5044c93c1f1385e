// The body with the prosthetic leg, and the course.
#pragma once

#include "sim/model/source.h"
#include "sim/render/camera_view.h"

namespace myograde::sim {

const ModelSource& LocomotionModel();

// Beside the walker and a little ahead, on the prosthesis' side.
const CameraView& LocomotionView();

}  // namespace myograde::sim
