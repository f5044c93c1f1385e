#include "sim/baoding/environment.h"

#include <cassert>
#include <utility>

#include "protocol/base/status_macros.h"
#include "sim/model/official_steps.h"

namespace myograde::sim {

absl::StatusOr<std::unique_ptr<BaodingEnvironment>> BaodingEnvironment::Make(
    const BaodingRules& rules, ModelPtr model) {
  ASSIGN_OR_RETURN(DataPtr data, MakeData(*model));
  ASSIGN_OR_RETURN(const BallScene scene, FindBallScene(*model));
  return std::unique_ptr<BaodingEnvironment>(
      new BaodingEnvironment(rules, std::move(model), std::move(data), scene));
}

BaodingEnvironment::BaodingEnvironment(const BaodingRules& rules, ModelPtr model, DataPtr data,
                                       const BallScene& scene)
    : HandEnvironment(kPhysicsSteps, rules, std::move(model), std::move(data)),
      rules_(rules),
      scene_(scene),
      first_path_(DrawFirstPath(rules)) {
  facts_.track = BaodingFacts{};
  if (!rules_.search_boxes_fixed) return;
  trees_.emplace(*model_, std::vector(scene_.bodies.begin(), scene_.bodies.end()));
}

void BaodingEnvironment::Reset(uint64_t seed) {
  const ContactSearch search(trees_);
  generator_ = NumpyGenerator(seed);
  variation_ = DrawBallVariation(rules_, scene_, generator_);
  ApplyBallVariation(variation_, rules_, scene_, *model_, *data_);
  const TargetPath& path = rules_.targets_late ? first_path_ : variation_.path;
  PlaceTargets(path, 0, scene_, *model_);
  ResetToDefaults(*model_, *data_);
  data_->qpos[0] = -1.57;  // rad: palm up; all other joints of the hand are at 0
  BeginEpisode(BaodingFacts{.direction = variation_.path.direction});
  ShowTargets();
}

StepResult BaodingEnvironment::Step(std::span<const double> action) {
  const int64_t steps = facts_.steps + (rules_.targets_late ? 0 : 1);
  const TargetPath& path = variation_.path;
  PlaceTargets(path, path.TurnAt(steps, control_period()), scene_, *model_);
  const StepResult result = MuscleEnvironment::Step(action);
  ShowTargets();
  return result;
}

void BaodingEnvironment::ShowTargets() {
  for (size_t i = 0; i < 2; ++i) {
    const int body = scene_.target_bodies[i];
    const mjtNum* place = data_->site_xpos + 3 * scene_.target_sites[i];
    mju_copy3(data_->mocap_pos + 3 * model_->body_mocapid[body], place);
    mju_copy3(data_->xpos + 3 * body, place);
    mju_copy3(data_->geom_xpos + 3 * model_->body_geomadr[body], place);
  }
}

void BaodingEnvironment::Measure(StepResult& result) {
  const Official now = official();
  auto& facts = std::get<BaodingFacts>(facts_.track);
  facts.distance_sum += (now.distances[0] + now.distances[1]) / 2;
  MeasureFlags<BaodingFacts>(now.solved, now.dropped, result);
}

BaodingEnvironment::Official BaodingEnvironment::official() const {
  Official now = {};
  for (size_t i = 0; i < 2; ++i) {
    const Eigen::Vector3d ball = SiteOf(*data_, scene_.sites[i]);
    now.errors[i] = SiteOf(*data_, scene_.target_sites[i]) - ball;
    now.distances[i] = now.errors[i].norm();
    now.dropped |= ball.z() < rules_.drop_height_m;
  }
  now.solved = now.distances[0] < rules_.position_tolerance_m &&
               now.distances[1] < rules_.position_tolerance_m && !now.dropped;
  return now;
}

// Order and sizes: protocol/tracks/baoding/layout.cc.
void BaodingEnvironment::Observe(std::span<double> out) const {
  assert(static_cast<int>(out.size()) == observation_size());
  using Eigen::VectorXd;
  const Official now = official();
  const auto velocity = [&](int ball) {
    const int joint = model_->body_jntadr[scene_.bodies[ball]];
    return VectorXd::Map(data_->qvel + model_->jnt_dofadr[joint], 3) * velocity_scale();
  };
  VectorXd::Map(out.data(), std::ssize(out)) << VectorXd::Map(data_->qpos, kHandJointCount),
      SiteOf(*data_, scene_.sites[0]), velocity(0), SiteOf(*data_, scene_.sites[1]), velocity(1),
      SiteOf(*data_, scene_.target_sites[0]), SiteOf(*data_, scene_.target_sites[1]), now.errors[0],
      now.errors[1], VectorXd::Map(data_->act, kHandMuscleCount);
}

void BaodingEnvironment::RewardTerms(std::span<double> out) const {
  const Official now = official();
  Eigen::VectorXd::Map(out.data(), std::ssize(out)) << -now.distances[0], -now.distances[1],
      -MuscleEffort(*model_, *data_), -(now.distances[0] + now.distances[1]),
      static_cast<double>(now.solved), static_cast<double>(now.dropped);
}

}  // namespace myograde::sim
