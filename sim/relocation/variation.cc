#include "sim/relocation/variation.h"

#include <numbers>

#include "protocol/base/status_macros.h"
#include "sim/model/finder.h"
#include "sim/model/official_steps.h"
#include "sim/model/rotation.h"

namespace myograde::sim {

using Eigen::Vector3d;

absl::StatusOr<RelocationScene> FindRelocationScene(const mjModel& model) {
  Finder find(model);
  RelocationScene scene;
  scene.object_body = find.Find(mjOBJ_BODY, "Object");
  scene.goal_body = find.Find(mjOBJ_BODY, "target");
  scene.object_site = find.Find(mjOBJ_SITE, "object_o");
  scene.goal_site = find.Find(mjOBJ_SITE, "target_o");
  scene.palm_site = find.Find(mjOBJ_SITE, "S_grasp");
  scene.first_geom = model.body_geomadr[scene.object_body];
  scene.mass = model.body_mass[scene.object_body];
  scene.inertia = Vector3d::Map(model.body_inertia + 3 * scene.object_body);
  RETURN_IF_ERROR(find.Check("relocation"));
  if (model.nq != 44 || model.nv != 44 || model.nu != 63 || model.na != 63 || model.nkey != 2 ||
      model.body_geomnum[scene.object_body] != RelocationVariation::kShapes ||
      mj_name2id(&model, mjOBJ_JOINT, "sternoclavicular_r2") != 0 ||
      mj_name2id(&model, mjOBJ_JOINT, "OBJTx") != 38) {
    return absl::InternalError(
        "the model of relocation does not have the expected joints and muscles");
  }
  return scene;
}

RelocationVariation DrawRelocationVariation(const RelocationRules& rules,
                                            NumpyGenerator& generator) {
  constexpr double kQuarterTurn = std::numbers::pi / 2;
  const auto draw = [&](const Vector3d& low, const Vector3d& high) {
    return DrawVector(low, high, generator);
  };
  const auto same = [](double number) -> Vector3d { return Vector3d::Constant(number); };
  RelocationVariation variation;
  variation.goal_position = draw(rules.goal_low_m, rules.goal_high_m);
  variation.goal_rotation =
      draw(same(rules.goal_rotation_rad[0]), same(rules.goal_rotation_rad[1]));
  variation.object_position = draw(rules.object_low_m, rules.object_high_m);
  for (RelocationVariation::Shape& shape : variation.shapes) {
    constexpr int kTypes = mjGEOM_BOX - mjGEOM_SPHERE + 1;
    shape.type = mjGEOM_SPHERE + static_cast<int>(generator.Integers(kTypes));
    shape.half_size = draw(rules.half_size_low_m, rules.half_size_high_m);
    shape.position = draw(-shape.half_size, shape.half_size);
    shape.rotation = draw(same(-kQuarterTurn), same(kQuarterTurn));
    shape.colour.head<3>() = draw(same(0.2), same(0.9)).cast<float>();
    shape.colour[3] = static_cast<float>(generator.Uniform(1, 1));  // a range of one value, drawn
    shape.friction = draw(rules.friction_low, rules.friction_high);
  }
  variation.mass = generator.Uniform(rules.mass_kg[0], rules.mass_kg[1]);
  return variation;
}

void ApplyRelocationVariation(const RelocationVariation& variation, const RelocationRules& rules,
                              const RelocationScene& scene, mjModel& model, mjData& data) {
  Vector3d::Map(model.body_pos + 3 * scene.goal_body) = variation.goal_position;
  Eigen::Vector4d::Map(model.body_quat + 4 * scene.goal_body) =
      OfficialQuaternion(variation.goal_rotation);
  Vector3d::Map(model.body_pos + 3 * scene.object_body) = variation.object_position;
  int geom = scene.first_geom;
  for (const RelocationVariation::Shape& shape : variation.shapes) {
    model.geom_type[geom] = shape.type;
    Vector3d::Map(model.geom_size + 3 * geom) = shape.half_size;
    model.geom_rbound[geom] = 2 * rules.half_size_high_m.maxCoeff();
    Vector3d::Map(model.geom_pos + 3 * geom) = shape.position;
    Eigen::Vector4d::Map(model.geom_quat + 4 * geom) = OfficialQuaternion(shape.rotation);
    Eigen::Vector4f::Map(model.geom_rgba + 4 * geom) = shape.colour;
    Vector3d::Map(model.geom_friction + 3 * geom) = shape.friction;
    ++geom;
  }
  model.body_mass[scene.object_body] = variation.mass;
  if (!rules.inertia_fixed) {
    Vector3d::Map(model.body_inertia + 3 * scene.object_body) =
        scene.inertia * (variation.mass / scene.mass);
    mj_setConst(&model, &data);
  }
}

}  // namespace myograde::sim
