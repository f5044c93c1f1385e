// Where things are in the arm model: ids and addresses, looked up by name once.
#pragma once

#include <array>

#include <Eigen/Core>
#include <absl/status/statusor.h>
#include <mujoco/mujoco.h>

#include "protocol/tracks/manipulation/details.h"

namespace myograde::sim {

inline constexpr int kMuscles = 63;
inline constexpr int kServos = 17;
inline constexpr int kArmJoints = 38;
inline constexpr int kProsthesisJoints = 26;
inline constexpr int kFingers = 5;

// Ids of the model's parts. All joints but the object's have one coordinate,
// so the arm's positions are qpos[0, 38) and velocities qvel[0, 38); those of
// the prosthesis follow, then the object's free joint.
struct Scene {
  int first_arm_body;         // the clavicle; bodies before it (but 0) are the torso's
  int first_prosthesis_body;  // bodies from the clavicle to it are the arm's
  int last_prosthesis_body;
  int object_body;
  int start_body, goal_body;  // pillars; also mocap bodies 0 and 1
  int object_box;             // geom: the box that collides
  int touch_site;             // on the object, centre of the touch sensor's sphere
  int palm_site;
  std::array<int, kFingers> finger_sites;  // thumb to little finger
  std::array<int, 2> prosthesis_palm_sites;  // thumb side, little finger side
  int object_qpos, object_qvel;
  int elbow_qpos;
  std::array<int, ManipulationDetails::kJoints.size()> detail_joints;  // their ranges are details
  int touch_sensor;  // address in sensordata
  int first_muscle, first_servo;  // actuators: muscles and servos are each in one piece
};

inline constexpr int kStartMocap = 0;
inline constexpr int kGoalMocap = 1;
inline constexpr int kStartKeyframe = 2;

// InternalError names a part that the model lacks.
absl::StatusOr<Scene> FindScene(const mjModel& model);

// Position in world coordinates of a point of the object, from qpos alone.
Eigen::Vector3d ObjectPoint(const mjData& data, const Scene& scene, const mjtNum local[3]);

}  // namespace myograde::sim
