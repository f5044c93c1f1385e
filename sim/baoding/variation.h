// What differs between episodes of Baoding balls: drawn in the official order, then written into
// the model.
#pragma once

#include <array>
#include <cstdint>

#include <absl/status/statusor.h>
#include <mujoco/mujoco.h>

#include "sim/baoding/rules.h"
#include "sim/random/numpy.h"

namespace myograde::sim {

// Where things are in the model: of the first and of the second ball each.
struct BallScene {
  std::array<int, 2> bodies, geoms, sites;  // of the balls
  std::array<int, 2> target_sites;
  std::array<int, 2> target_bodies;  // which show the targets in pictures
  Eigen::Vector3d friction;          // of both in the model: sliding, torsional, rolling
  double size;                       // m, likewise
};

// InternalError names what the model lacks.
absl::StatusOr<BallScene> FindBallScene(const mjModel& model);

// Two targets opposite each other on an ellipse in the palm's frame.
struct TargetPath {
  int direction = 0;       // -1 clockwise, 0 at rest, 1 counter-clockwise
  double start_angle = 0;  // rad, of the first ball's
  double x_radius = 0;     // m
  double y_radius = 0;     // m
  double period = 1;       // s, of a turn

  // rad, from the start, after so many control steps of `step_s`.
  double TurnAt(int64_t steps, double step_s) const;
};

// Moves the targets in the model to where they are after that turn (rad).
void PlaceTargets(const TargetPath& path, double turn, const BallScene& scene, mjModel& model);

// The path whose start a new official environment shows until its first step: its constructor draws
// radii, from a generator of its own.
TargetPath DrawFirstPath(const BaodingRules& rules);

struct BallVariation {
  TargetPath path;
  std::array<double, 2> masses = {};              // kg
  std::array<Eigen::Vector3d, 2> frictions = {};  // as BallScene::friction
  std::array<double, 2> sizes = {};               // m, radii
};

BallVariation DrawBallVariation(const BaodingRules& rules, const BallScene& scene,
                                NumpyGenerator& generator);

// Writes the balls into the model. Where inertia follows what was drawn, the constants that depend
// on it are computed anew with the help of `data`, whose state is lost. Call before a reset.
void ApplyBallVariation(const BallVariation& variation, const BaodingRules& rules,
                        const BallScene& scene, mjModel& model, mjData& data);

}  // namespace myograde::sim
