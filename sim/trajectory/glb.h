// Writes binary glTF 2.0: meshes, nodes and materials, with quantised points (KHR_mesh_quantization).
#pragma once

#include <array>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "sim/trajectory/mesh.h"

namespace myograde::sim {

// A place for something in the frame of something else.
struct Placement {
  std::array<double, 3> position = {0, 0, 0};     // m
  std::array<double, 4> rotation = {1, 0, 0, 0};  // w, x, y, z
};

class GlbWriter {
 public:
  // Adds a mesh with normals. Returns its index.
  int AddMesh(const Mesh& mesh, int material);
  // Red, green, blue and opacity in [0, 1], as they are shown (not linear). The same one again has
  // the same index.
  int AddMaterial(const std::array<float, 4>& colour);
  // Adds a node without a mesh, or one that shows the mesh of this index. Returns its index.
  int AddNode(const std::string& name, const Placement& place, int mesh = -1);
  void SetChildren(int node, const std::vector<int>& children);

  // The file: one scene with one root node.
  std::string Finish(int root, const nlohmann::json& extras);

 private:
  // How the whole numbers of a mesh's points become lengths.
  struct Grid {
    std::array<double, 3> origin;  // m
    double size;                   // m, of the whole range
  };

  int AddView(const std::string& bytes, int stride, int target);
  int AddAccessor(nlohmann::json accessor);

  nlohmann::json accessors_ = nlohmann::json::array();
  nlohmann::json views_ = nlohmann::json::array();
  nlohmann::json meshes_ = nlohmann::json::array();
  nlohmann::json materials_ = nlohmann::json::array();
  nlohmann::json nodes_ = nlohmann::json::array();
  std::vector<std::array<float, 4>> colours_;
  std::vector<Grid> grids_;  // of the meshes
  std::string bytes_;
};

}  // namespace myograde::sim
