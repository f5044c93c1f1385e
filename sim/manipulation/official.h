// The official environment's view of a state: the derived quantities of its
// observation dictionary and its reward terms. Observation and facts use some
// of them; the tests compare all of them with recordings.
#pragma once

#include <array>

#include <mujoco/mujoco.h>

#include "sim/manipulation/scene.h"

namespace myograde::sim {

using Vector3 = std::array<double, 3>;

// World frame, m and rad.
struct OfficialView {
  Vector3 palm;
  std::array<Vector3, kFingers> fingers;  // tips, thumb first
  Vector3 prosthesis_palm;                // mean of its two sites
  Vector3 prosthesis_orientation;         // roll, pitch, yaw as the official code takes them
  Vector3 prosthesis_orientation_error;   // towards (pi, 0, pi), not wrapped
  Vector3 object;                         // the touch site
  Vector3 reach_error;                    // palm - object
  Vector3 pass_error;                     // prosthesis palm - object
};

OfficialView ComputeOfficialView(const mjData& data, const Scene& scene);

// The terms of a step's reward. `solved` and `done` are not here: they depend
// on the episode so far.
struct OfficialReward {
  double reach_dist, act, fin_open, fin_dis, lift_bonus, lift_height, pass_err, goal_dist, dense;
};

// What the reward needs from the reset.
struct RewardReference {
  double object_height;  // m, touch site's z at the reset
  double palm_height;    // m
  Vector3 goal;          // m, centre of the goal pillar's top face
};

OfficialReward ComputeOfficialReward(const mjModel& model, const mjData& data,
                                     const Scene& scene, const OfficialView& view,
                                     const RewardReference& reference);

}  // namespace myograde::sim
