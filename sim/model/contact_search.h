// Which contacts of two bodies MuJoCo 3.1.2 finds, and in which order: it searches along trees of
// boxes around their shapes, which are made when a model is compiled. Who changes shapes later, as
// an official environment does, loses contacts outside of the boxes. MuJoCo 2.2.2 has no such trees.
// Source: mj_collision and mj_collideTree in engine_collision_driver.c.
#pragma once

#include <mujoco/mujoco.h>

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace myograde::sim {

// The trees around the shapes that a model has now; those of the world are left out, as its floor
// has no end.
class BoundingTrees {
 public:
  // `bodies` are those whose contacts are searched for along trees.
  BoundingTrees(const mjModel& model, std::vector<int> bodies);

  // The box (half sizes in m) that a geom itself is searched by, around its centre.
  void SetGeomBox(int geom, const Eigen::Vector3d& half_size) { geom_boxes_[geom] = half_size; }

  // True if a search between the two geoms' bodies gets as far as them, at the positions in `data`,
  // or does not go along trees. REQUIRES: their bodies differ.
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

  std::vector<int> bodies_;
  std::vector<Eigen::Vector3d> geom_boxes_;  // half sizes
  std::vector<Path> paths_;                  // of geoms; empty for those that touch nothing
};

// While it lives, Forward and Integrate have the contacts of MuJoCo 3.1.2 in this thread: in its
// order, on which the last digits of the solver depend, and only those that a search along `trees`
// finds, if there are some.
class ContactSearch {
 public:
  explicit ContactSearch(const std::optional<BoundingTrees>& trees);
  ~ContactSearch();
  ContactSearch(const ContactSearch&) = delete;
  ContactSearch& operator=(const ContactSearch&) = delete;

 private:
  bool sorted_before_;
  const BoundingTrees* trees_before_;
};

// mj_forward and, REQUIRES: Euler's integrator, mj_step; without a ContactSearch nothing else.
void Forward(const mjModel& model, mjData& data);
void Integrate(const mjModel& model, mjData& data);

}  // namespace myograde::sim
