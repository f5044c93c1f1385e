#include "sim/trajectory/figure.h"

#include <algorithm>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde::sim {
namespace {

constexpr double kThinnestMuscle = 0.002;  // m

std::string NameOf(const mjModel& model, int type, int id) {
  const char* name = mj_id2name(&model, type, id);
  return name == nullptr ? "" : name;
}

bool Moves(const mjModel& model, int body) {
  if (body == 0) return false;
  return model.body_jntnum[body] > 0 || model.body_mocapid[body] >= 0;
}

absl::Status ListParts(const mjModel& model, Figure& figure) {
  for (int body = 0; body < model.nbody; ++body) {
    if (Moves(model, body)) {
      if (NameOf(model, mjOBJ_BODY, body).empty()) {
        return absl::InvalidArgumentError(
            absl::StrCat("body ", body, " moves but has no name, so pictures can't refer to it"));
      }
      figure.part_of.push_back(static_cast<int>(figure.parts.size()));
      figure.parts.push_back(body);
    } else {
      figure.part_of.push_back(body == 0 ? -1 : figure.part_of[model.body_parentid[body]]);
    }
  }
  // The first part of a tree is what the others are near.
  std::vector<int> first_of_tree(static_cast<size_t>(model.nbody), -1);
  for (size_t i = 0; i < figure.parts.size(); ++i) {
    int& first = first_of_tree[model.body_rootid[figure.parts[i]]];
    figure.from.push_back(first);
    // What is fixed at its root stays where it is, and there is nothing to be near to.
    const bool free = figure.parts[i] == model.body_rootid[figure.parts[i]];
    if (first < 0 && free) first = static_cast<int>(i);
  }
  return absl::OkStatus();
}

int WrapIndex(Figure& figure, int geom, int part) {
  figure.wraps.push_back({geom, part});
  return static_cast<int>(figure.wraps.size()) - 1;
}

absl::Status AddPath(const mjModel& model, Figure& figure, MusclePath& muscle) {
  const int begin = model.tendon_adr[muscle.tendon];
  for (int i = begin; i < begin + model.tendon_num[muscle.tendon]; ++i) {
    const int id = model.wrap_objid[i];
    switch (model.wrap_type[i]) {
      case mjWRAP_SITE: {
        const int body = model.site_bodyid[id];
        muscle.points.push_back({figure.part_of[body],
                                 PointInPart(model, figure, body, model.site_pos + 3 * id)});
        break;
      }
      case mjWRAP_SPHERE:
      case mjWRAP_CYLINDER: {
        const int part = figure.part_of[model.geom_bodyid[id]];
        muscle.points.push_back({part, {}, WrapIndex(figure, id, part)});
        break;
      }
      default:
        return absl::InvalidArgumentError(absl::StrCat(
            "muscle ", muscle.name, " has a pulley or a joint on its path, which can't be shown"));
    }
  }
  return absl::OkStatus();
}

absl::Status ListMuscles(const mjModel& model, Figure& figure) {
  for (int actuator = 0; actuator < model.nu; ++actuator) {
    // Activations are those of the actuators that have one, which come last.
    const int activation = actuator - (model.nu - model.na);
    if (activation < 0 || model.actuator_trntype[actuator] != mjTRN_TENDON) continue;
    MusclePath muscle;
    muscle.name = NameOf(model, mjOBJ_ACTUATOR, actuator);
    muscle.tendon = model.actuator_trnid[2 * actuator];
    muscle.activation = activation;
    muscle.radius = std::max<double>(model.tendon_width[muscle.tendon], kThinnestMuscle);
    RETURN_IF_ERROR(AddPath(model, figure, muscle));
    figure.muscles.push_back(std::move(muscle));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Figure> BuildFigure(const mjModel& model) {
  Figure figure;
  absl::Status status = ListParts(model, figure);
  if (status.ok()) status = ListMuscles(model, figure);
  if (!status.ok()) return status;
  return figure;
}

RelativePose PoseInPart(const mjModel& model, const Figure& figure, int body) {
  RelativePose pose = {{0, 0, 0}, {1, 0, 0, 0}};
  const int part = figure.part_of[body];
  const int end = part < 0 ? 0 : figure.parts[part];
  for (int at = body; at != end; at = model.body_parentid[at]) {
    mjtNum position[3];
    mjtNum rotation[4];
    mju_rotVecQuat(position, pose.position.data(), model.body_quat + 4 * at);
    mju_add3(pose.position.data(), position, model.body_pos + 3 * at);
    mju_mulQuat(rotation, model.body_quat + 4 * at, pose.rotation.data());
    mju_copy4(pose.rotation.data(), rotation);
  }
  return pose;
}

std::array<double, 3> PointInPart(const mjModel& model, const Figure& figure, int body,
                                  const mjtNum point[3]) {
  const RelativePose pose = PoseInPart(model, figure, body);
  std::array<double, 3> moved;
  mju_rotVecQuat(moved.data(), point, pose.rotation.data());
  mju_addTo3(moved.data(), pose.position.data());
  return moved;
}

}  // namespace myograde::sim
