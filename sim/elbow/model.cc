#include "sim/elbow/model.h"

#include "sim/elbow/pins.h"

namespace myograde::sim {

// Nothing in its files needs a patch, and no body that moves gets its mass from a mesh (README.md
// has the comparison). In play the arm touches nothing, the only constraint is the joint's stop,
// and the stack holds 60 numbers: the buffers are many times of that, and still small.
const ModelSource& ElbowModel() {
  static const ModelSource source = {
      .name = "elbow",
      .pins = elbow::kPins,
      .main_file = "envs/myo/assets/elbow/myoelbow_1dof6muscles.xml",
      .actuator_file = "simhive/myo_sim/elbow/assets/myoelbow_1dof6muscles_body.xml",
      .inertials = {},
      .buffers = {200, 50, 200'000},
      .patch = nullptr};
  return source;
}

const CameraView& ElbowView() {
  // From the side, where the forearm moves in the plane of the picture and muscles are before the bones.
  static const CameraView view = {.look_at = {-0.15, -0.05, 1.15}, .distance_m = 1.05, .azimuth_deg = 0,
                                  .elevation_deg = -10};
  return view;
}

}  // namespace myograde::sim
