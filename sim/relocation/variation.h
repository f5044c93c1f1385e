// What differs between episodes of relocation: drawn in the official order, then written into the
// model.
#pragma once

#include <absl/status/statusor.h>
#include <mujoco/mujoco.h>

#include <array>

#include "sim/random/numpy.h"
#include "sim/relocation/rules.h"

namespace myograde::sim {

// Where things are in the model, and what the drawn mass is relative to.
struct RelocationScene {
  int object_body, goal_body, object_site, goal_site, palm_site;
  int first_geom;           // of the object's three
  double mass;              // kg, of the object
  Eigen::Vector3d inertia;  // kg m^2, principal
};

// InternalError names what the model lacks.
absl::StatusOr<RelocationScene> FindRelocationScene(const mjModel& model);

struct RelocationVariation {
  static constexpr int kShapes = 3;
  // One of the object's shapes, in the object's frame.
  struct Shape {
    int type = 0;               // mjGEOM_SPHERE to mjGEOM_BOX
    Eigen::Vector3d half_size;  // m; of a sphere only the first is used, of a capsule or cylinder
                                // the first two
    Eigen::Vector3d position;   // m
    Eigen::Vector3d rotation;   // rad, Euler angles
    Eigen::Vector4f colour;     // red, green, blue, opacity
    Eigen::Vector3d friction;   // sliding, torsional, rolling
  };

  Eigen::Vector3d goal_position, object_position;  // m, of the bodies
  Eigen::Vector3d goal_rotation;                   // rad, Euler angles
  std::array<Shape, kShapes> shapes;
  double mass = 0;  // kg
};

RelocationVariation DrawRelocationVariation(const RelocationRules& rules,
                                            NumpyGenerator& generator);

// Writes it into the model. Where inertia follows what was drawn, the constants that depend on it
// are computed anew with the help of `data`, whose state is lost. Call before a reset.
void ApplyRelocationVariation(const RelocationVariation& variation, const RelocationRules& rules,
                              const RelocationScene& scene, mjModel& model, mjData& data);

}  // namespace myograde::sim
