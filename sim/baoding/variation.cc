#include "sim/baoding/variation.h"

#include <absl/strings/str_cat.h>

#include <cmath>
#include <numbers>

#include "protocol/base/status_macros.h"
#include "sim/model/finder.h"
#include "sim/model/official_steps.h"

namespace myograde::sim {
namespace baoding {
namespace {

using Eigen::Vector3d;

constexpr double kPi = std::numbers::pi;
constexpr double kCentre[] = {-0.0125, -0.07};  // m, of the ellipse in the palm's frame
constexpr int kTasks[] = {0, -1, 1};            // directions, in the order of the official tasks
// A constructor that is given no seed draws from the system's entropy. This one stands for all, so
// that an episode depends on its own seed alone.
constexpr uint64_t kConstructorSeed = 0;

int DrawDirection(NumpyGenerator& generator) {
  return kTasks[generator.Integers(std::size(kTasks))];
}

double DrawFrom(const std::array<double, 2>& range, NumpyGenerator& generator) {
  return generator.Uniform(range[0], range[1]);
}

void DrawRadii(const BaodingRules& rules, TargetPath& path, NumpyGenerator& generator) {
  path.x_radius = DrawFrom(rules.x_radius_m, generator);
  path.y_radius = DrawFrom(rules.y_radius_m, generator);
}

}  // namespace
}  // namespace baoding

absl::StatusOr<BallScene> FindBallScene(const mjModel& model) {
  Finder find(model);
  BallScene scene;
  for (size_t i = 0; i < 2; ++i) {
    const std::string number = absl::StrCat(i + 1);
    scene.bodies[i] = find.Find(mjOBJ_BODY, absl::StrCat("ball", number).c_str());
    scene.geoms[i] = find.Find(mjOBJ_GEOM, absl::StrCat("ball", number).c_str());
    scene.sites[i] = find.Find(mjOBJ_SITE, absl::StrCat("ball", number, "_site").c_str());
    scene.target_sites[i] = find.Find(mjOBJ_SITE, absl::StrCat("target", number, "_site").c_str());
    scene.target_bodies[i] = find.Find(mjOBJ_BODY, absl::StrCat("target", number).c_str());
  }
  RETURN_IF_ERROR(find.Check("baoding"));
  if (model.nq != 37 || model.nv != 35 || model.nu != 39 || model.na != 39 || model.nmocap != 2 ||
      mj_name2id(&model, mjOBJ_JOINT, "pro_sup") != 0) {
    return absl::InternalError("the hand's model does not have the expected joints and muscles");
  }
  scene.friction = Eigen::Vector3d::Map(model.geom_friction + 3 * scene.geoms[0]);
  scene.size = model.geom_size[3 * scene.geoms[0]];
  return scene;
}

double TargetPath::TurnAt(int64_t steps, double step_s) const {
  return direction * 2 * baoding::kPi * (static_cast<double>(steps) * step_s / period);
}

void PlaceTargets(const TargetPath& path, double turn, const BallScene& scene, mjModel& model) {
  double start = path.start_angle;
  for (const int site : scene.target_sites) {
    mjtNum* position = model.site_pos + 3 * site;
    position[0] = path.x_radius * std::cos(turn + start) + baoding::kCentre[0];
    position[1] = path.y_radius * std::sin(turn + start) + baoding::kCentre[1];
    start -= baoding::kPi;  // the second ball's is opposite
  }
}

TargetPath DrawFirstPath(const BaodingRules& rules) {
  NumpyGenerator generator(baoding::kConstructorSeed);
  baoding::DrawDirection(generator);  // decides nothing: the first step is at the start
  TargetPath path = {.start_angle = baoding::kPi / 4};
  baoding::DrawRadii(rules, path, generator);
  return path;
}

BallVariation DrawBallVariation(const BaodingRules& rules, const BallScene& scene,
                                NumpyGenerator& generator) {
  using baoding::DrawFrom;
  BallVariation variation;
  variation.path.direction = baoding::DrawDirection(generator);
  variation.path.start_angle = generator.Uniform(0, 2 * baoding::kPi);
  baoding::DrawRadii(rules, variation.path, generator);
  variation.path.period = DrawFrom(rules.period_s, generator);
  for (double& mass : variation.masses) mass = DrawFrom(rules.mass_kg, generator);
  for (Eigen::Vector3d& friction : variation.frictions) {
    friction = DrawVector(scene.friction - rules.friction_change,
                          scene.friction + rules.friction_change, generator);
  }
  for (double& size : variation.sizes) size = DrawFrom(rules.size_m, generator);
  return variation;
}

void ApplyBallVariation(const BallVariation& variation, const BaodingRules& rules,
                        const BallScene& scene, mjModel& model, mjData& data) {
  using Eigen::Vector3d;
  for (size_t i = 0; i < 2; ++i) {
    const double mass = variation.masses[i];
    const double radius = variation.sizes[i];
    model.body_mass[scene.bodies[i]] = mass;
    Vector3d::Map(model.geom_friction + 3 * scene.geoms[i]) = variation.frictions[i];
    // A sphere has one size; the official code writes it into all three entries.
    Vector3d::Map(model.geom_size + 3 * scene.geoms[i]) = Vector3d::Constant(radius);
    if (!rules.bounding_radius_fixed) model.geom_rbound[scene.geoms[i]] = radius;
    if (!rules.inertia_fixed) {
      Vector3d::Map(model.body_inertia + 3 * scene.bodies[i]) =
          Vector3d::Constant(0.4 * mass * radius * radius);
    }
  }
  if (!rules.inertia_fixed) mj_setConst(&model, &data);
}

}  // namespace myograde::sim
