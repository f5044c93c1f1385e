// Where a picture is taken from.
#pragma once

#include <array>
#include <string_view>

namespace myograde::sim {

// A camera that looks at a point from a distance, as MuJoCo's viewer does.
struct CameraView {
  // The body that the camera moves along with, by its name in the model; empty: it stands still.
  std::string_view body = {};
  // The point in the middle of the picture, m: from the body's origin along the world's axes, or
  // from the world's origin.
  std::array<double, 3> look_at = {0, 0, 0};
  double distance_m = 3;      // from that point
  double azimuth_deg = 90;    // the direction of view in the plane: 0 looks along x, 90 along y
  double elevation_deg = -15;  // below 0: looks down
};

}  // namespace myograde::sim
