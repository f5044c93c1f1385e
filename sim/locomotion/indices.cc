#include "sim/locomotion/indices.h"

#include <absl/strings/str_cat.h>

#include <algorithm>
#include <string>
#include <vector>

#include "protocol/base/set_up.h"
#include "protocol/base/status_macros.h"
#include "sim/model/finder.h"

namespace myograde::sim {
namespace {

constexpr std::array<const char*, kObservedJoints> kJointNames = {
    "hip_adduction_l",
    "hip_flexion_l",
    "hip_rotation_l",
    "hip_adduction_r",
    "hip_flexion_r",
    "hip_rotation_r",
    "knee_angle_l",
    "knee_angle_l_beta_rotation1",
    "knee_angle_l_beta_translation1",
    "knee_angle_l_beta_translation2",
    "knee_angle_l_rotation2",
    "knee_angle_l_rotation3",
    "knee_angle_l_translation1",
    "knee_angle_l_translation2",
    "mtp_angle_l",
    "ankle_angle_l",
    "subtalar_angle_l"};

constexpr std::array<const char*, kFootMarkers> kFootMarkerNames = {"r_heel_btm", "r_toe_btm",
                                                                    "l_heel_btm", "l_toe_btm"};

// Every actuator with an activation is a muscle; they keep the official order.
std::vector<int> Muscles(const mjModel& model) {
  std::vector<int> muscles;
  for (int i = 0; i < model.nu; ++i) {
    if (model.actuator_dyntype[i] == mjDYN_MUSCLE) muscles.push_back(i);
  }
  return muscles;
}

}  // namespace

absl::StatusOr<LocomotionIndices> FindLocomotionIndices(const mjModel& model) {
  LocomotionIndices out;
  const std::vector<int> muscles = Muscles(model);
  if (std::ssize(muscles) != kLegMuscles || model.na != kLegMuscles ||
      model.nu != kLegMuscles + 2 || mj_isSparse(&model)) {
    return absl::InternalError(absl::StrCat("the leg model has ", muscles.size(), " muscles, ",
                                            model.nu, " actuators and ", model.nv,
                                            " degrees of freedom, expected 54, 56 and fewer "
                                            "than 60: ", SetUpAdvice()));
  }
  std::copy(muscles.begin(), muscles.end(), out.muscle.begin());
  out.sorted_muscle = out.muscle;
  std::sort(out.sorted_muscle.begin(), out.sorted_muscle.end(), [&](int a, int b) {
    return std::string(mj_id2name(&model, mjOBJ_ACTUATOR, a)) <
           mj_id2name(&model, mjOBJ_ACTUATOR, b);
  });

  Finder find(model);
  out.field = find.Find(mjOBJ_HFIELD, "terrain");
  out.field_geom = find.Find(mjOBJ_GEOM, "terrain");
  out.head_site = find.Find(mjOBJ_SITE, "head");
  for (int i = 0; i < kFootMarkers; ++i) {
    out.foot_sites[i] = find.Find(mjOBJ_SITE, kFootMarkerNames[i]);
  }
  out.pelvis_body = find.Find(mjOBJ_BODY, "pelvis");
  out.talus_body = find.Find(mjOBJ_BODY, "talus_l");
  out.leg_foot_body = find.Find(mjOBJ_BODY, "osl_foot_assembly");
  for (int i = 0; i < kObservedJoints; ++i) {
    out.joint_qpos[i] = find.Qpos(kJointNames[i]);
    out.joint_dof[i] = find.Dof(kJointNames[i]);
  }
  // The names are literals, so they end with a null.
  for (int i = 0; i < kPainJoints; ++i) {
    out.pain_dof[i] = find.Dof(LocomotionDetails::kPainJoints[i].data());
  }
  for (size_t i = 0; i < out.detail_joints.size(); ++i) {
    out.detail_joints[i] = find.Find(mjOBJ_JOINT, LocomotionDetails::kJoints[i].data());
  }
  out.knee_qpos = find.Qpos("osl_knee_angle_r");
  out.knee_dof = find.Dof("osl_knee_angle_r");
  out.ankle_qpos = find.Qpos("osl_ankle_angle_r");
  out.ankle_dof = find.Dof("osl_ankle_angle_r");
  out.knee_motor = find.Find(mjOBJ_ACTUATOR, "osl_knee_torque_actuator");
  out.ankle_motor = find.Find(mjOBJ_ACTUATOR, "osl_ankle_torque_actuator");
  out.left_foot_touch = find.Sensor("l_foot");
  out.left_toes_touch = find.Sensor("l_toes");
  out.leg_load = find.Sensor("r_osl_load");
  out.socket_load = find.Sensor("r_socket_load");
  RETURN_IF_ERROR(find.Check("locomotion"));
  return out;
}

}  // namespace myograde::sim
