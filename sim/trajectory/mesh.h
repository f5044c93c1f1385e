// Triangles for a model's shapes.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <mujoco/mujoco.h>

namespace myograde::sim {

struct Mesh {
  std::vector<std::array<float, 3>> points;   // m, in the geom's frame
  std::vector<std::array<float, 3>> normals;  // unit vectors, one for each point; empty: none yet
  std::vector<std::array<uint32_t, 3>> faces;  // indices of points, counterclockwise from outside
};

// The shape of a geom that is a mesh, box, sphere, capsule, cylinder or ellipsoid; of any other kind,
// no faces.
Mesh BuildMesh(const mjModel& model, int geom);

// The same with at most `most` faces: points that are near to each other become one, and faces that
// vanish by it go.
Mesh Simplified(Mesh mesh, size_t most);

// Gives it normals: smooth where faces meet at less than 40 degrees; along sharper edges points are
// doubled.
Mesh WithNormals(const Mesh& mesh);

}  // namespace myograde::sim
