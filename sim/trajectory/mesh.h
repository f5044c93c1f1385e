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

// Its longest extent along an axis, in m.
double SizeOf(const Mesh& mesh);

// The same with one point for each cube of a grid, whose side is `side` m: the mean of those that are in
// it. Faces that vanish by it go, and of equal ones all but one.
Mesh Simplified(const Mesh& mesh, double side);

// Gives it normals: smooth where faces meet at less than 60 degrees; along sharper edges points are
// doubled.
Mesh WithNormals(const Mesh& mesh);

}  // namespace myograde::sim
