#include "sim/manipulation/scene.h"

#include <absl/strings/str_cat.h>

namespace myograde::sim {
namespace {

// Looks up names and remembers the first that is not there.
class Finder {
 public:
  explicit Finder(const mjModel& model) : model_(model) {}

  int operator()(mjtObj type, const char* name) {
    const int id = mj_name2id(&model_, type, name);
    if (id < 0 && missing_.empty()) missing_ = name;
    return id < 0 ? 0 : id;
  }
  const std::string& missing() const { return missing_; }

 private:
  const mjModel& model_;
  std::string missing_;
};

}  // namespace

absl::StatusOr<Scene> FindScene(const mjModel& model) {
  Finder find(model);
  Scene scene;
  scene.first_arm_body = find(mjOBJ_BODY, "clavicle");
  scene.first_prosthesis_body = find(mjOBJ_BODY, "prosthesis/Lmpl_attach");
  scene.last_prosthesis_body = find(mjOBJ_BODY, "prosthesis/pinky3");
  scene.object_body = find(mjOBJ_BODY, "manip_object");
  scene.start_body = find(mjOBJ_BODY, "start");
  scene.goal_body = find(mjOBJ_BODY, "goal");
  scene.touch_site = find(mjOBJ_SITE, "touch_site");
  scene.palm_site = find(mjOBJ_SITE, "S_grasp");
  const char* const tips[kFingers] = {"THtip", "IFtip", "MFtip", "RFtip", "LFtip"};
  for (int i = 0; i < kFingers; ++i) scene.finger_sites[i] = find(mjOBJ_SITE, tips[i]);
  scene.prosthesis_palm_sites = {find(mjOBJ_SITE, "prosthesis/palm_thumb"),
                                 find(mjOBJ_SITE, "prosthesis/palm_pinky")};
  const int object_joint = find(mjOBJ_JOINT, "manip_object/freejoint");
  scene.object_qpos = model.jnt_qposadr[object_joint];
  scene.object_qvel = model.jnt_dofadr[object_joint];
  scene.elbow_qpos = model.jnt_qposadr[find(mjOBJ_JOINT, "elbow_flexion")];
  scene.first_muscle = find(mjOBJ_ACTUATOR, "DELT1");
  scene.first_servo = find(mjOBJ_ACTUATOR, "prosthesis/Lshoulder_fe");
  scene.touch_sensor = 0;
  // The object's second geom is its box; the first is the picture of it.
  scene.object_box = model.body_geomadr[scene.object_body] + 1;
  if (!find.missing().empty()) {
    return absl::InternalError(absl::StrCat("the arm model has no ", find.missing()));
  }
  if (model.nu != kMuscles + kServos || model.na != kMuscles || model.nsensordata != 1 ||
      model.nq != kArmJoints + kProsthesisJoints + 7 || scene.object_qpos != model.nq - 7 ||
      model.body_geomnum[scene.object_body] != 2 ||
      model.geom_type[scene.object_box] != mjGEOM_BOX) {
    return absl::InternalError("the arm model does not have the expected joints and actuators");
  }
  return scene;
}

std::array<double, 3> ObjectPoint(const mjData& data, const Scene& scene,
                                  const mjtNum local[3]) {
  const mjtNum* pose = data.qpos + scene.object_qpos;
  mjtNum rotation[4];
  mju_copy4(rotation, pose + 3);
  mju_normalize4(rotation);
  std::array<double, 3> point;
  mju_rotVecQuat(point.data(), local, rotation);
  mju_addTo3(point.data(), pose);
  return point;
}

}  // namespace myograde::sim
