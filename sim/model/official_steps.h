// What the official environments have in common: how they reset, step and excite muscles. Golden
// recordings depend on the last bits of it.
#pragma once

#include <cmath>
#include <utility>

#include <Eigen/Core>
#include <mujoco/mujoco.h>

#include "sim/environment.h"
#include "sim/model/contact_search.h"
#include "sim/model/warnings.h"
#include "sim/random/numpy.h"

namespace myograde::sim {

// A normalised muscle action as its excitation: half at 0.5, never quite 0 or 1.
inline double Excitation(double action) { return 1 / (1 + std::exp(-5 * (action - 0.5))); }

// |activations| / their number. By MuJoCo, whose sum rounds otherwise than Eigen's: recorded
// efforts depend on it.
inline double MuscleEffort(const mjModel& model, const mjData& data) {
  return mju_norm(data.act, model.na) / model.na;
}

// A site's position in the world, m.
inline auto SiteOf(const mjData& data, int site) {
  return Eigen::Vector3d::Map(data.site_xpos + 3 * site);
}

// The model's own state. The passive forward step leaves nothing but the solver's warm start
// behind, which the next one begins from.
inline void ResetToDefaults(mjModel& model, mjData& data) {
  mj_resetData(&model, &data);
  const int flags = std::exchange(model.opt.disableflags,
                                  model.opt.disableflags | mjDSBL_ACTUATION);
  Forward(model, data);
  model.opt.disableflags = flags;
}

// A control step: `substeps` integrations under constant controls, then an evaluation of the
// resulting state. Positions, velocities and what follows from them are there from the last
// evaluation, so the first integration only needs its second half. With `warnings_reset`,
// MuJoCo's warnings of bad numbers reset the simulation and are forgotten, as in the official code.
inline StepResult PlayControlStep(mjModel& model, mjData& data, int substeps,
                                  bool warnings_reset) {
  mj_step2(&model, &data);
  for (int i = 1; i < substeps; ++i) Integrate(model, data);
  mj_checkPos(&model, &data);
  mj_checkVel(&model, &data);
  StepResult result;
  result.overflow = Overflown(data);
  if (warnings_reset && !result.overflow && BadNumbers(data)) ResetToDefaults(model, data);
  Forward(model, data);
  result.overflow = result.overflow || Overflown(data);
  result.unstable = BadNumbers(data);
  return result;
}

// One number for each axis, in the order of the axes.
inline Eigen::Vector3d DrawVector(const Eigen::Vector3d& low, const Eigen::Vector3d& high,
                                  NumpyGenerator& generator) {
  Eigen::Vector3d drawn;
  for (int i = 0; i < 3; ++i) drawn[i] = generator.Uniform(low[i], high[i]);
  return drawn;
}

}  // namespace myograde::sim
