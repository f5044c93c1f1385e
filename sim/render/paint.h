// Colours and textures for models that were compiled without their textures (sim/README.md).
#pragma once

#include <array>
#include <vector>

#include <mujoco/mujoco.h>

namespace myograde::sim {

// Our own textures: a sky, and a checkered floor. They are made here and read from no file.
class Textures {
 public:
  Textures();
  // Makes `model`, a shallow copy of a model, show them. It must not outlive this object.
  void PutInto(mjModel& model);

 private:
  std::vector<int> type_, height_, width_, address_;
  std::vector<mjtByte> rgb_;
};

// Gives a scene's geoms the colours of what they are (bone, floor, box), and muscles that of how
// active they are. Geoms with colours of their own keep them.
void Paint(const mjModel& model, const mjData& data, mjvScene& scene);

// The colour that Paint gives to a geom: red, green, blue and opacity in [0, 1].
std::array<float, 4> GeomColour(const mjModel& model, int geom);

}  // namespace myograde::sim
