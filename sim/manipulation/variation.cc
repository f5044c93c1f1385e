#include "sim/manipulation/variation.h"

#include "sim/model/official_steps.h"

namespace myograde::sim {
namespace {

using Eigen::Vector3d;

// centre + spread (2 r - 1), as the official code writes it: a number is used up even where
// the spread is zero.
Vector3d DrawPlace(const Vector3d& centre, const Vector3d& spread, NumpyGenerator& generator) {
  const Vector3d draws = DrawVector(Vector3d::Zero(), Vector3d::Ones(), generator);
  return centre + spread.cwiseProduct(2 * draws - Vector3d::Ones());
}

// A solid box of the drawn size and mass, its centre of mass in its middle.
void SetSolidBox(const Variation& variation, const Scene& scene, mjModel& model) {
  const int body = scene.object_body;
  const Vector3d square = variation.half_size.cwiseAbs2();
  Vector3d::Map(model.body_inertia + 3 * body) =
      variation.mass / 3 * Vector3d(square.y() + square.z(), square.z() + square.x(),
                                    square.x() + square.y());
  mju_copy3(model.body_ipos + 3 * body, model.geom_pos + 3 * scene.object_box);
  mju_copy4(model.body_iquat + 4 * body, model.geom_quat + 4 * scene.object_box);
}

}  // namespace

Variation DrawVariation(const ManipulationRules& rules, bool draw_size,
                        NumpyGenerator& generator) {
  Variation variation;
  variation.start = DrawPlace(rules.start_centre_m, rules.start_spread_m, generator);
  variation.goal = DrawPlace(rules.goal_centre_m, rules.goal_spread_m, generator);
  variation.mass = generator.Uniform(rules.mass_kg - rules.mass_spread_kg,
                                     rules.mass_kg + rules.mass_spread_kg);
  variation.friction = DrawVector(rules.friction - rules.friction_spread,
                                  rules.friction + rules.friction_spread, generator);
  variation.half_size = rules.half_size_m;
  if (draw_size) {
    variation.half_size.array() *=
        DrawVector(-rules.size_spread, rules.size_spread, generator).array() + 1;
  }
  return variation;
}

void ApplyVariation(const Variation& variation, const ManipulationRules& rules,
                    const Scene& scene, mjModel& model, mjData& data) {
  Vector3d::Map(model.body_pos + 3 * scene.start_body) = variation.start;
  Vector3d::Map(model.body_pos + 3 * scene.goal_body) = variation.goal;
  model.body_mass[scene.object_body] = variation.mass;
  const int box = scene.object_box;
  Vector3d::Map(model.geom_friction + 3 * box) = variation.friction;
  Vector3d::Map(model.geom_size + 3 * box) = variation.half_size;
  if (!rules.bounding_radius_fixed) model.geom_rbound[box] = variation.half_size.norm();
  if (rules.inertia == ManipulationRules::Inertia::kSolidBox) {
    SetSolidBox(variation, scene, model);
    mj_setConst(&model, &data);
  }
}

}  // namespace myograde::sim
