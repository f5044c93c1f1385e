// The arm, the prosthesis and the object.
#pragma once

#include "sim/model/source.h"
#include "sim/render/camera_view.h"

namespace myograde::sim {

const ModelSource& ManipulationModel();

// From the front, over both pillars.
const CameraView& ManipulationView();

}  // namespace myograde::sim
