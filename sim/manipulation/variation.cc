#include "sim/manipulation/variation.h"

#include <algorithm>

namespace myograde::sim {
namespace {

using Vector = Variation::Vector;

// centre + spread (2 r - 1), as the official code writes it: all three numbers
// are drawn first, and one is used up even where the spread is zero.
Vector DrawPlace(const Vector& centre, const Vector& spread, NumpyGenerator& generator) {
  Vector draws;
  for (double& draw : draws) draw = generator.Random();
  Vector place;
  for (int i = 0; i < 3; ++i) place[i] = centre[i] + spread[i] * (2 * draws[i] - 1);
  return place;
}

// A solid box of the drawn size and mass, its centre of mass in its middle.
void SetSolidBox(const Variation& variation, const Scene& scene, mjModel& model) {
  const int body = scene.object_body;
  const Vector& h = variation.half_size;
  mjtNum* inertia = model.body_inertia + 3 * body;
  for (int axis = 0; axis < 3; ++axis) {
    const double a = h[(axis + 1) % 3];
    const double b = h[(axis + 2) % 3];
    inertia[axis] = variation.mass / 3 * (a * a + b * b);
  }
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
  for (int i = 0; i < 3; ++i) {
    variation.friction[i] = generator.Uniform(rules.friction[i] - rules.friction_spread[i],
                                              rules.friction[i] + rules.friction_spread[i]);
  }
  variation.half_size = rules.half_size_m;
  if (draw_size) {
    for (int i = 0; i < 3; ++i) {
      variation.half_size[i] *=
          generator.Uniform(-rules.size_spread[i], rules.size_spread[i]) + 1;
    }
  }
  return variation;
}

void ApplyVariation(const Variation& variation, const ManipulationRules& rules,
                    const Scene& scene, mjModel& model, mjData& data) {
  std::ranges::copy(variation.start, model.body_pos + 3 * scene.start_body);
  std::ranges::copy(variation.goal, model.body_pos + 3 * scene.goal_body);
  model.body_mass[scene.object_body] = variation.mass;
  const int box = scene.object_box;
  std::ranges::copy(variation.friction, model.geom_friction + 3 * box);
  std::ranges::copy(variation.half_size, model.geom_size + 3 * box);
  if (!rules.bounding_radius_fixed) {
    model.geom_rbound[box] = mju_norm3(variation.half_size.data());
  }
  if (rules.inertia == ManipulationRules::Inertia::kSolidBox) {
    SetSolidBox(variation, scene, model);
    mj_setConst(&model, &data);
  }
}

}  // namespace myograde::sim
