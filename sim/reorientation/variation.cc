#include "sim/reorientation/variation.h"

#include <cmath>

#include "protocol/base/status_macros.h"
#include "sim/model/finder.h"
#include "sim/model/official_steps.h"
#include "sim/model/rotation.h"

namespace myograde::sim {
namespace reorientation {
namespace {

using Eigen::Vector3d;

constexpr int kBoxes = 3;  // the last of the die's geoms
constexpr int kGeoms = 12 + kBoxes;
constexpr double kInertialHalfEdge = 0.03;  // m, of a cube with the inertia of the model's file

std::vector<double> OfGeoms(const mjtNum* array, int first) {
  return {array + 3 * first, array + 3 * (first + kGeoms)};
}

// The official code scales a position by its sign, which it takes as p / |p + 1e-16|: nearly 1,
// and 0 for 0.
double Moved(double position, double change) {
  return position / std::abs(position + 1e-16) * (std::abs(position) + change);
}

// Capsules along the edges become longer, not thicker.
void ResizeGeoms(double change, const DieScene& scene, mjModel& model) {
  for (int i = 0; i < kGeoms; ++i) {
    mjtNum* size = model.geom_size + 3 * (scene.first_geom + i);
    mjtNum* position = model.geom_pos + 3 * (scene.first_geom + i);
    const bool box = i >= kGeoms - kBoxes;
    for (int axis = 0; axis < 3; ++axis) {
      if (box || axis == 1) size[axis] = scene.sizes[3 * i + axis] + change;
      position[axis] = Moved(scene.positions[3 * i + axis], change);
    }
  }
}

double BoundingRadius(const mjModel& model, int geom) {
  const mjtNum* size = model.geom_size + 3 * geom;
  return model.geom_type[geom] == mjGEOM_BOX ? mju_norm3(size) : size[0] + size[1];
}

}  // namespace
}  // namespace reorientation

absl::StatusOr<DieScene> FindDieScene(const mjModel& model, mjData& data) {
  using reorientation::OfGeoms;
  Finder find(model);
  DieScene scene;
  scene.die_body = find.Find(mjOBJ_BODY, "Object");
  scene.goal_body = find.Find(mjOBJ_BODY, "target");
  scene.goal_geom = find.Find(mjOBJ_GEOM, "target_dice");
  scene.die_site = find.Find(mjOBJ_SITE, "object_o");
  scene.goal_site = find.Find(mjOBJ_SITE, "target_o");
  scene.first_geom = model.body_geomadr[scene.die_body];
  RETURN_IF_ERROR(find.Check("reorientation"));
  if (model.nq != 29 || model.nv != 29 || model.nu != 39 || model.na != 39 ||
      model.body_geomnum[scene.die_body] != reorientation::kGeoms ||
      mj_name2id(&model, mjOBJ_JOINT, "pro_sup") != 0 ||
      mj_name2id(&model, mjOBJ_JOINT, "OBJTx") != 23) {
    return absl::InternalError("the hand's model does not have the expected joints and muscles");
  }
  mj_resetData(&model, &data);
  mj_forward(&model, &data);
  scene.goal_position = SiteOf(data, scene.goal_site);
  scene.goal_offset = scene.goal_position - SiteOf(data, scene.die_site);
  scene.goal_size = Eigen::Vector3d::Map(model.geom_size + 3 * scene.goal_geom);
  scene.positions = OfGeoms(model.geom_pos, scene.first_geom);
  scene.sizes = OfGeoms(model.geom_size, scene.first_geom);
  scene.friction = OfGeoms(model.geom_friction, scene.first_geom);
  return scene;
}

DieVariation DrawDieVariation(const ReorientationRules& rules, const DieScene& scene,
                              NumpyGenerator& generator) {
  using Eigen::Vector3d;
  const auto axes = [&](const std::array<double, 2>& range) {
    return DrawVector(Vector3d::Constant(range[0]), Vector3d::Constant(range[1]), generator);
  };
  DieVariation variation;
  variation.goal_position = scene.goal_position + axes(rules.goal_position_m);
  variation.goal_rotation = axes(rules.goal_rotation_rad);
  for (size_t i = 0; i < scene.friction.size(); ++i) {
    const double change = rules.friction_change[static_cast<Eigen::Index>(i % 3)];
    variation.friction.push_back(
        generator.Uniform(scene.friction[i] - change, scene.friction[i] + change));
  }
  variation.mass = generator.Uniform(rules.mass_kg[0], rules.mass_kg[1]);
  variation.size_change = generator.Uniform(-rules.size_change_m, rules.size_change_m);
  return variation;
}

void ApplyDieVariation(const DieVariation& variation, const ReorientationRules& rules,
                       const DieScene& scene, mjModel& model, mjData& data) {
  using Eigen::Vector3d;
  using reorientation::kGeoms;
  Vector3d::Map(model.body_pos + 3 * scene.goal_body) = variation.goal_position;
  Eigen::Vector4d::Map(model.body_quat + 4 * scene.goal_body) =
      OfficialQuaternion(variation.goal_rotation);
  mju_copy(model.geom_friction + 3 * scene.first_geom, variation.friction.data(), 3 * kGeoms);
  model.body_mass[scene.die_body] = variation.mass;
  Vector3d::Map(model.geom_size + 3 * scene.goal_geom) =
      scene.goal_size.array() + variation.size_change;
  reorientation::ResizeGeoms(variation.size_change, scene, model);
  for (int geom = scene.first_geom; geom < scene.first_geom + kGeoms; ++geom) {
    if (!rules.bounding_radius_fixed) model.geom_rbound[geom] = reorientation::BoundingRadius(model, geom);
  }
  if (!rules.inertia_fixed) {
    const double half_edge = reorientation::kInertialHalfEdge + variation.size_change;
    Vector3d::Map(model.body_inertia + 3 * scene.die_body) =
        Vector3d::Constant(variation.mass * 2 / 3 * half_edge * half_edge);
    mj_setConst(&model, &data);
  }
}

}  // namespace myograde::sim
