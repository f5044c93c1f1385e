// The official environment's view of a state: the derived quantities of its
// observation dictionary and its reward terms. Observation and facts use some
// of them; the tests compare all of them with recordings.
#pragma once

#include <Eigen/Core>
#include <mujoco/mujoco.h>

#include "sim/manipulation/scene.h"

namespace myograde::sim {

// World frame, m and rad.
struct OfficialView {
  Eigen::Vector3d palm;
  Eigen::Matrix<double, 3, kFingers> fingers;    // tips, a column each, thumb first
  Eigen::Vector3d prosthesis_palm;               // mean of its two sites
  Eigen::Vector3d prosthesis_orientation;        // roll, pitch, yaw
  Eigen::Vector3d prosthesis_orientation_error;  // towards (pi, 0, pi), not wrapped
  Eigen::Vector3d object;                        // the touch site
  Eigen::Vector3d reach_error;                   // palm - object
  Eigen::Vector3d pass_error;                    // prosthesis palm - object
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
  Eigen::Vector3d goal;  // m, centre of the goal pillar's top face
};

OfficialReward ComputeOfficialReward(const mjModel& model, const mjData& data,
                                     const Scene& scene, const OfficialView& view,
                                     const RewardReference& reference);

}  // namespace myograde::sim
