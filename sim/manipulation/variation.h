// What differs between episodes: drawn in the official order, then written into
// the model.
#pragma once

#include <Eigen/Core>
#include <mujoco/mujoco.h>

#include "sim/manipulation/rules.h"
#include "sim/manipulation/scene.h"
#include "sim/random/numpy.h"

namespace myograde::sim {

struct Variation {
  Eigen::Vector3d start, goal;  // m, world: the pillars' mocap positions
  double mass;                  // kg
  Eigen::Vector3d friction;     // sliding, torsional, rolling
  Eigen::Vector3d half_size;    // m
};

// Draws an episode's variation. Without `draw_size` the size is the nominal one
// and takes no numbers from the stream.
Variation DrawVariation(const ManipulationRules& rules, bool draw_size,
                        NumpyGenerator& generator);

// Writes it into the model. With a solid box's inertia, the constants that
// follow from inertia are computed anew with the help of `data`, whose state is
// lost. Call before the simulation is reset.
void ApplyVariation(const Variation& variation, const ManipulationRules& rules,
                    const Scene& scene, mjModel& model, mjData& data);

}  // namespace myograde::sim
