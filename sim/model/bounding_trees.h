// How MuJoCo 3.1.2 searches two bodies for contacts: along trees of boxes around their shapes,
// which are made when a model is compiled. Who changes shapes later, as an official environment
// does, loses contacts outside of the boxes. MuJoCo 2.2.2 has no such trees.
#pragma once

#include <mujoco/mujoco.h>

#include <Eigen/Core>
#include <vector>

namespace myograde::sim {

// The trees around the shapes that a model has now; those of the world are left out, as its floor
// has no end.
class BoundingTrees {
 public:
  explicit BoundingTrees(const mjModel& model);

  // The box (half sizes in m) that a geom itself is searched by, around its centre.
  void SetGeomBox(int geom, const Eigen::Vector3d& half_size) { geom_boxes_[geom] = half_size; }

  // True if a search between the two bodies gets as far as the two geoms, at the positions in
  // `data`. REQUIRES: their bodies differ.
  bool Reach(const mjModel& model, const mjData& data, int geom1, int geom2) const;

 private:
  struct Box {
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    Eigen::Vector3d half = Eigen::Vector3d::Zero();
  };
  // The nodes from the root of a body's tree to a geom's leaf, boxes in the body's inertial frame.
  using Path = std::vector<Box>;

  static Eigen::Vector3d HalfSizeOf(const mjModel& model, int geom);
  void Build(const mjModel& model, int body, const std::vector<int>& geoms, Path path);

  std::vector<Eigen::Vector3d> geom_boxes_;  // half sizes
  std::vector<Path> paths_;                  // of geoms; empty for those that touch nothing
};

// While it lives, contacts of the body `body` are searched for along the trees in this thread.
// REQUIRES: no other lives in this thread.
class TreeSearch {
 public:
  TreeSearch(const BoundingTrees& trees, int body);
  ~TreeSearch();
  TreeSearch(const TreeSearch&) = delete;
  TreeSearch& operator=(const TreeSearch&) = delete;
};

}  // namespace myograde::sim
