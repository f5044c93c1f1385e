#include "sim/manipulation/scene.h"

#include "protocol/base/status_macros.h"
#include "sim/model/finder.h"

namespace myograde::sim {

absl::StatusOr<Scene> FindScene(const mjModel& model) {
  Finder find(model);
  Scene scene;
  scene.first_arm_body = find.Find(mjOBJ_BODY, "clavicle");
  scene.first_prosthesis_body = find.Find(mjOBJ_BODY, "prosthesis/Lmpl_attach");
  scene.last_prosthesis_body = find.Find(mjOBJ_BODY, "prosthesis/pinky3");
  scene.object_body = find.Find(mjOBJ_BODY, "manip_object");
  scene.start_body = find.Find(mjOBJ_BODY, "start");
  scene.goal_body = find.Find(mjOBJ_BODY, "goal");
  scene.touch_site = find.Find(mjOBJ_SITE, "touch_site");
  scene.palm_site = find.Find(mjOBJ_SITE, "S_grasp");
  const char* const tips[kFingers] = {"THtip", "IFtip", "MFtip", "RFtip", "LFtip"};
  for (int i = 0; i < kFingers; ++i) scene.finger_sites[i] = find.Find(mjOBJ_SITE, tips[i]);
  scene.prosthesis_palm_sites = {find.Find(mjOBJ_SITE, "prosthesis/palm_thumb"),
                                 find.Find(mjOBJ_SITE, "prosthesis/palm_pinky")};
  scene.object_qpos = find.Qpos("manip_object/freejoint");
  scene.object_qvel = find.Dof("manip_object/freejoint");
  scene.elbow_qpos = find.Qpos("elbow_flexion");
  for (size_t i = 0; i < scene.detail_joints.size(); ++i) {
    // The names are literals, so they end with a null.
    scene.detail_joints[i] = find.Find(mjOBJ_JOINT, ManipulationDetails::kJoints[i].data());
  }
  scene.first_muscle = find.Find(mjOBJ_ACTUATOR, "DELT1");
  scene.first_servo = find.Find(mjOBJ_ACTUATOR, "prosthesis/Lshoulder_fe");
  scene.touch_sensor = 0;
  // The object's second geom is its box; the first is the picture of it.
  scene.object_box = model.body_geomadr[scene.object_body] + 1;
  RETURN_IF_ERROR(find.Check("manipulation"));
  if (model.nu != kMuscles + kServos || model.na != kMuscles || model.nsensordata != 1 ||
      model.nq != kArmJoints + kProsthesisJoints + 7 || scene.object_qpos != model.nq - 7 ||
      model.body_geomnum[scene.object_body] != 2 ||
      model.geom_type[scene.object_box] != mjGEOM_BOX) {
    return absl::InternalError("the arm model does not have the expected joints and actuators");
  }
  return scene;
}

Eigen::Vector3d ObjectPoint(const mjData& data, const Scene& scene, const mjtNum local[3]) {
  // Turned by MuJoCo, which rounds otherwise than Eigen: recorded heights depend on it.
  const mjtNum* pose = data.qpos + scene.object_qpos;
  Eigen::Vector4d rotation = Eigen::Vector4d::Map(pose + 3);
  mju_normalize4(rotation.data());
  Eigen::Vector3d turned;
  mju_rotVecQuat(turned.data(), local, rotation.data());
  return turned + Eigen::Vector3d::Map(pose);
}

}  // namespace myograde::sim
