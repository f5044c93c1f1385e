// How far an object is from where and how its goal is, as the official environments of objects
// compute it.
#pragma once

#include <mujoco/mujoco.h>

#include <Eigen/Core>
#include <cmath>
#include <numbers>

#include "sim/model/official_steps.h"
#include "sim/model/rotation.h"

namespace myograde::sim {

struct PoseError {
  Eigen::Vector3d position_error;           // m, from the object to its place
  Eigen::Vector3d rotation, goal_rotation;  // rad, Euler angles in the world
  Eigen::Vector3d rotation_error;           // rad, the goal's minus the object's
  double distance;                          // m, |position_error|
  double turn;                              // rad, |rotation_error|
};

// Between two sites; `offset` (m) is from the place that is meant to the goal's site. The official
// differences of angles are `unwrapped`; else each is the shorter way round.
inline PoseError PoseErrorOf(const mjData& data, int object_site, int goal_site, bool unwrapped,
                             const Eigen::Vector3d& offset = Eigen::Vector3d::Zero()) {
  PoseError now;
  now.position_error = SiteOf(data, goal_site) - SiteOf(data, object_site) - offset;
  now.rotation = OfficialEulerAngles(Rotation::Map(data.site_xmat + 9 * object_site));
  now.goal_rotation = OfficialEulerAngles(Rotation::Map(data.site_xmat + 9 * goal_site));
  now.rotation_error = now.goal_rotation - now.rotation;
  if (!unwrapped) {
    for (double& angle : now.rotation_error) angle = std::remainder(angle, 2 * std::numbers::pi);
  }
  now.distance = now.position_error.norm();
  now.turn = now.rotation_error.norm();
  return now;
}

}  // namespace myograde::sim
