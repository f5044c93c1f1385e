// Where the things that the locomotion track asks for are in the model, looked
// up by name once.
#pragma once

#include <array>

#include <absl/status/statusor.h>
#include <mujoco/mujoco.h>

#include "protocol/tracks/locomotion/details.h"

namespace myograde::sim {

inline constexpr int kLegMuscles = 54;
inline constexpr int kObservedJoints = 17;
inline constexpr int kPainJoints = LocomotionDetails::kPainJoints.size();
inline constexpr int kFootMarkers = 4;

struct LocomotionIndices {
  int field = 0;       // height field
  int field_geom = 0;
  int head_site = 0;
  std::array<int, kFootMarkers> foot_sites;
  int pelvis_body = 0;
  int talus_body = 0;       // sound foot
  int leg_foot_body = 0;    // prosthetic foot
  // Joints of the observation, in its order.
  std::array<int, kObservedJoints> joint_qpos;
  std::array<int, kObservedJoints> joint_dof;
  // Joints whose limit torque is pain.
  std::array<int, kPainJoints> pain_dof;
  // Joints (ids) whose ranges are details.
  std::array<int, LocomotionDetails::kJoints.size()> detail_joints;
  int knee_qpos = 0, knee_dof = 0, ankle_qpos = 0, ankle_dof = 0;  // of the prosthesis
  int knee_motor = 0, ankle_motor = 0;                             // actuators
  // Actuators of the muscles in the order of actions and activations, and in
  // the alphabetical order of the observation's lengths, velocities and forces.
  std::array<int, kLegMuscles> muscle;
  std::array<int, kLegMuscles> sorted_muscle;
  int left_foot_touch = 0, left_toes_touch = 0, leg_load = 0, socket_load = 0;  // in sensordata
};

// Fails with InternalError when the model lacks one of the names or its sizes
// are not those of the challenge.
absl::StatusOr<LocomotionIndices> FindLocomotionIndices(const mjModel& model);

}  // namespace myograde::sim
