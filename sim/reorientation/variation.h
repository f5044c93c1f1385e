// What differs between episodes of die reorientation: drawn in the official order, then written
// into the model.
#pragma once

#include <vector>

#include <absl/status/statusor.h>
#include <mujoco/mujoco.h>

#include "sim/random/numpy.h"
#include "sim/reorientation/rules.h"

namespace myograde::sim {

// Where things are in the model, and what the drawn changes are relative to.
struct DieScene {
  int die_body, goal_body, goal_geom, die_site, goal_site;
  int first_geom;  // of the die: 12 capsules along its edges, then 3 boxes
  Eigen::Vector3d goal_offset;  // m, from the die to the goal in the model's own state
  Eigen::Vector3d goal_position, goal_size;  // m
  // Of the die's geoms, 3 numbers each: m, m, and sliding, torsional, rolling.
  std::vector<double> positions, sizes, friction;
};

// Evaluates the model's own state in `data`. InternalError names what the model lacks.
absl::StatusOr<DieScene> FindDieScene(const mjModel& model, mjData& data);

struct DieVariation {
  Eigen::Vector3d goal_position = {};  // m, of the goal's body
  Eigen::Vector3d goal_rotation = {};  // rad, Euler angles
  std::vector<double> friction;        // as DieScene::friction
  double mass = 0;                     // kg
  double size_change = 0;              // m, of half an edge
};

DieVariation DrawDieVariation(const ReorientationRules& rules, const DieScene& scene,
                              NumpyGenerator& generator);

// Writes it into the model. Where inertia follows what was drawn, the constants that depend on it
// are computed anew with the help of `data`, whose state is lost. Call before a reset.
void ApplyDieVariation(const DieVariation& variation, const ReorientationRules& rules,
                       const DieScene& scene, mjModel& model, mjData& data);

}  // namespace myograde::sim
