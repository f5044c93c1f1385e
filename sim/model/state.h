// The physics state of a model as digests know it.
#pragma once

#include <vector>

#include <Eigen/Core>
#include <mujoco/mujoco.h>

namespace myograde::sim {

// Time, positions, velocities and activations, one after the other. Allocates only where `state`
// does not yet have their number of entries.
inline void CopyState(const mjModel& model, const mjData& data, std::vector<double>& state) {
  using Eigen::VectorXd;
  state.resize(1 + model.nq + model.nv + model.na);
  VectorXd::Map(state.data(), std::ssize(state)) << data.time, VectorXd::Map(data.qpos, model.nq),
      VectorXd::Map(data.qvel, model.nv), VectorXd::Map(data.act, model.na);
}

}  // namespace myograde::sim
