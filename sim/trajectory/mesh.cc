#include "sim/trajectory/mesh.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <span>
#include <utility>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <absl/container/flat_hash_map.h>
#include <absl/container/flat_hash_set.h>

namespace myograde::sim {
namespace {

using Eigen::Vector3f;

constexpr int kSides = 32;         // of round shapes, around
constexpr int kArcs = 8;           // of a hemisphere, from its equator to its pole
constexpr float kSmooth = 0.5F;    // cosine of the sharpest smooth edge

Vector3f At(const Mesh& mesh, uint32_t point) {
  return Vector3f::Map(mesh.points[point].data());
}

Mesh MeshAsset(const mjModel& model, int id) {
  Mesh mesh;
  const float* points = model.mesh_vert + 3 * model.mesh_vertadr[id];
  for (int i = 0; i < model.mesh_vertnum[id]; ++i) {
    mesh.points.push_back({points[3 * i], points[3 * i + 1], points[3 * i + 2]});
  }
  const int* faces = model.mesh_face + 3 * model.mesh_faceadr[id];
  for (int i = 0; i < model.mesh_facenum[id]; ++i) {
    mesh.faces.push_back({static_cast<uint32_t>(faces[3 * i]),
                          static_cast<uint32_t>(faces[3 * i + 1]),
                          static_cast<uint32_t>(faces[3 * i + 2])});
  }
  return mesh;
}

// A circle of a shape that is round about z.
struct Ring {
  double radius;
  double height;
};

// The surface between rings, from the lowest to the highest; those of radius 0 close it.
Mesh Lathe(std::span<const Ring> rings) {
  Mesh mesh;
  for (const Ring& ring : rings) {
    for (int side = 0; side < kSides; ++side) {
      const double angle = 2 * std::numbers::pi * side / kSides;
      mesh.points.push_back({static_cast<float>(ring.radius * std::cos(angle)),
                             static_cast<float>(ring.radius * std::sin(angle)),
                             static_cast<float>(ring.height)});
    }
  }
  for (uint32_t r = 0; r + 1 < rings.size(); ++r) {
    for (uint32_t side = 0; side < kSides; ++side) {
      const uint32_t next = (side + 1) % kSides;
      const uint32_t a = r * kSides + side, b = r * kSides + next;
      const uint32_t c = a + kSides, d = b + kSides;
      if (rings[r].radius > 0) mesh.faces.push_back({a, b, d});
      if (rings[r + 1].radius > 0) mesh.faces.push_back({a, d, c});
    }
  }
  return mesh;
}

// Two hemispheres whose equators are `half` above and below the middle.
Mesh Capsule(double radius, double half) {
  std::vector<Ring> rings;
  for (int sign : {-1, 1}) {
    for (int i = 0; i <= kArcs; ++i) {
      const int step = sign < 0 ? kArcs - i : i;
      const double angle = std::numbers::pi / 2 * step / kArcs;
      const double across = step == kArcs ? 0 : radius * std::cos(angle);
      rings.push_back({across, sign * (half + radius * std::sin(angle))});
    }
  }
  if (half == 0) rings.erase(rings.begin() + kArcs);  // one equator
  return Lathe(rings);
}

Mesh Cylinder(double radius, double half) {
  const Ring rings[] = {{0, -half}, {radius, -half}, {radius, half}, {0, half}};
  return Lathe(rings);
}

Mesh Box(const mjtNum half[3]) {
  Mesh mesh;
  for (int corner = 0; corner < 8; ++corner) {
    std::array<float, 3> point;
    for (int axis = 0; axis < 3; ++axis) {
      point[axis] = static_cast<float>((corner >> axis & 1) != 0 ? half[axis] : -half[axis]);
    }
    mesh.points.push_back(point);
  }
  mesh.faces = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return mesh;
}

Mesh Ellipsoid(const mjtNum radii[3]) {
  Mesh mesh = Capsule(1, 0);
  for (auto& point : mesh.points) {
    for (int axis = 0; axis < 3; ++axis) point[axis] *= static_cast<float>(radii[axis]);
  }
  return mesh;
}

// Twice the area long.
Vector3f FaceNormal(const Mesh& mesh, const std::array<uint32_t, 3>& face) {
  const Vector3f a = At(mesh, face[0]);
  return (At(mesh, face[1]) - a).cross(At(mesh, face[2]) - a);
}

bool ShareEdgeAt(uint32_t point, const std::array<uint32_t, 3>& a,
                 const std::array<uint32_t, 3>& b) {
  return std::any_of(a.begin(), a.end(), [&](uint32_t corner) {
    return corner != point && std::find(b.begin(), b.end(), corner) != b.end();
  });
}

// Splits the faces around a point into groups that are smooth within: group numbers, from 0.
std::vector<int> SmoothGroups(const Mesh& mesh, const std::vector<Vector3f>& normals,
                              uint32_t point, const std::vector<uint32_t>& around) {
  std::vector<int> group(around.size(), -1);
  int groups = 0;
  for (size_t first = 0; first < around.size(); ++first) {
    if (group[first] >= 0) continue;
    std::vector<size_t> open = {first};
    group[first] = groups;
    while (!open.empty()) {
      const size_t at = open.back();
      open.pop_back();
      for (size_t other = 0; other < around.size(); ++other) {
        if (group[other] >= 0 ||
            !ShareEdgeAt(point, mesh.faces[around[at]], mesh.faces[around[other]]) ||
            normals[around[at]].normalized().dot(normals[around[other]].normalized()) < kSmooth) {
          continue;
        }
        group[other] = groups;
        open.push_back(other);
      }
    }
    ++groups;
  }
  return group;
}

}  // namespace

Mesh BuildMesh(const mjModel& model, int geom) {
  const mjtNum* size = model.geom_size + 3 * geom;
  switch (model.geom_type[geom]) {
    case mjGEOM_MESH: return MeshAsset(model, model.geom_dataid[geom]);
    case mjGEOM_BOX: return Box(size);
    case mjGEOM_SPHERE: return Capsule(size[0], 0);
    case mjGEOM_CAPSULE: return Capsule(size[0], size[1]);
    case mjGEOM_CYLINDER: return Cylinder(size[0], size[1]);
    case mjGEOM_ELLIPSOID: return Ellipsoid(size);
    default: return Mesh();
  }
}

double SizeOf(const Mesh& mesh) {
  if (mesh.points.empty()) return 0;
  Vector3f low = At(mesh, 0), high = low;
  for (uint32_t i = 0; i < mesh.points.size(); ++i) {
    low = low.cwiseMin(At(mesh, i));
    high = high.cwiseMax(At(mesh, i));
  }
  return (high - low).maxCoeff();
}

Mesh Simplified(const Mesh& mesh, double side) {
  absl::flat_hash_map<std::array<int, 3>, uint32_t> cells;
  std::vector<uint32_t> cell_of;
  std::vector<Vector3f> sums;
  std::vector<float> counts;
  for (uint32_t i = 0; i < mesh.points.size(); ++i) {
    const Eigen::Vector3i cell = (At(mesh, i) / static_cast<float>(side)).array().floor().cast<int>();
    const auto [entry, is_new] = cells.try_emplace({cell.x(), cell.y(), cell.z()},
                                                   static_cast<uint32_t>(sums.size()));
    if (is_new) {
      sums.push_back(Vector3f::Zero());
      counts.push_back(0);
    }
    sums[entry->second] += At(mesh, i);
    ++counts[entry->second];
    cell_of.push_back(entry->second);
  }
  Mesh out;
  for (size_t i = 0; i < sums.size(); ++i) {
    const Vector3f mean = sums[i] / counts[i];
    out.points.push_back({mean.x(), mean.y(), mean.z()});
  }
  absl::flat_hash_set<std::array<uint32_t, 3>> seen;
  for (const auto& face : mesh.faces) {
    std::array<uint32_t, 3> now = {cell_of[face[0]], cell_of[face[1]], cell_of[face[2]]};
    if (now[0] == now[1] || now[1] == now[2] || now[2] == now[0]) continue;
    std::rotate(now.begin(), std::min_element(now.begin(), now.end()), now.end());
    if (seen.insert(now).second) out.faces.push_back(now);
  }
  return out;
}

Mesh WithNormals(const Mesh& mesh) {
  std::vector<Vector3f> face_normals;
  std::vector<std::vector<uint32_t>> around(mesh.points.size());
  for (uint32_t i = 0; i < mesh.faces.size(); ++i) {
    face_normals.push_back(FaceNormal(mesh, mesh.faces[i]));
    for (const uint32_t corner : mesh.faces[i]) around[corner].push_back(i);
  }
  Mesh out;
  out.faces = mesh.faces;
  for (uint32_t point = 0; point < mesh.points.size(); ++point) {
    const std::vector<int> group = SmoothGroups(mesh, face_normals, point, around[point]);
    std::map<int, uint32_t> copies;
    std::vector<Vector3f> sums;
    for (size_t i = 0; i < around[point].size(); ++i) {
      const auto [copy, is_new] =
          copies.try_emplace(group[i], static_cast<uint32_t>(out.points.size()));
      if (is_new) {
        out.points.push_back(mesh.points[point]);
        sums.emplace_back(Vector3f::Zero());
      }
      sums[static_cast<size_t>(group[i])] += face_normals[around[point][i]];
      auto& face = out.faces[around[point][i]];
      for (size_t corner = 0; corner < 3; ++corner) {
        if (mesh.faces[around[point][i]][corner] == point) face[corner] = copy->second;
      }
    }
    for (const Vector3f& sum : sums) {
      const Vector3f normal = sum.norm() > 0 ? Vector3f(sum.normalized()) : Vector3f::UnitZ();
      out.normals.push_back({normal.x(), normal.y(), normal.z()});
    }
  }
  return out;
}

}  // namespace myograde::sim
