// Looks up the parts of a model by name.
#pragma once

#include <absl/status/status.h>
#include <absl/strings/str_cat.h>
#include <mujoco/mujoco.h>

#include <string>

#include "protocol/base/set_up.h"

namespace myograde::sim {

// What the model lacks counts as number 0; the first such name is kept for Check.
class Finder {
 public:
  explicit Finder(const mjModel& model) : model_(model) {}

  int Find(mjtObj type, const char* name) {
    const int id = mj_name2id(&model_, type, name);
    if (id < 0 && missing_.empty()) missing_ = name;
    return id < 0 ? 0 : id;
  }
  // Addresses in qpos, qvel and sensordata.
  int Qpos(const char* joint) { return model_.jnt_qposadr[Find(mjOBJ_JOINT, joint)]; }
  int Dof(const char* joint) { return model_.jnt_dofadr[Find(mjOBJ_JOINT, joint)]; }
  int Sensor(const char* name) { return model_.sensor_adr[Find(mjOBJ_SENSOR, name)]; }

  // InternalError: the model of `what` lacks a part that was looked up.
  absl::Status Check(const char* what) const {
    if (missing_.empty()) return absl::OkStatus();
    return absl::InternalError(
        absl::StrCat("the model of ", what, " has no ", missing_, ": ", SetUpAdvice()));
  }

 private:
  const mjModel& model_;
  std::string missing_;
};

}  // namespace myograde::sim
