#include "sim/reorientation/environment.h"

#include <algorithm>
#include <cassert>
#include <utility>

#include "protocol/base/status_macros.h"
#include "sim/model/official_steps.h"

namespace myograde::sim {
absl::StatusOr<std::unique_ptr<ReorientationEnvironment>> ReorientationEnvironment::Make(
    const ReorientationRules& rules, ModelPtr model) {
  ASSIGN_OR_RETURN(DataPtr data, MakeData(*model));
  ASSIGN_OR_RETURN(auto scene, FindDieScene(*model, *data));
  return std::unique_ptr<ReorientationEnvironment>(new ReorientationEnvironment(
      rules, std::move(model), std::move(data), std::move(scene)));
}

ReorientationEnvironment::ReorientationEnvironment(const ReorientationRules& rules, ModelPtr model,
                                                   DataPtr data, DieScene scene)
    : HandEnvironment(kPhysicsSteps, rules, std::move(model), std::move(data)),
      rules_(rules),
      scene_(std::move(scene)) {
  facts_.track = ReorientationFacts{};
  if (rules_.search_boxes_fixed) trees_.emplace(*model_, std::vector{scene_.die_body});
}

void ReorientationEnvironment::Reset(uint64_t seed) {
  const ContactSearch search(trees_);
  generator_ = NumpyGenerator(seed);
  variation_ = DrawDieVariation(rules_, scene_, generator_);
  ApplyDieVariation(variation_, rules_, scene_, *model_, *data_);
  ResetToDefaults(*model_, *data_);
  data_->qpos[0] = -1.5;  // rad: palm up; all other joints are at 0
  BeginEpisode(ReorientationFacts{});
  const Official now = official();
  facts_.track = ReorientationFacts{.final_position_error = now.distance,
                                    .final_rotation_error = now.turn,
                                    .smallest_rotation_error = now.turn};
}

void ReorientationEnvironment::Measure(StepResult& result) {
  auto& facts = std::get<ReorientationFacts>(facts_.track);
  const Official now = official();
  const bool first = measured_steps_ == 1;
  facts.final_position_error = now.distance;
  facts.final_rotation_error = now.turn;
  facts.smallest_rotation_error =
      first ? now.turn : std::min(facts.smallest_rotation_error, now.turn);
  MeasureFlags<ReorientationFacts>(now.solved, now.dropped, result);
}

ReorientationEnvironment::Official ReorientationEnvironment::official() const {
  Official now;
  static_cast<PoseError&>(now) =
      PoseErrorOf(*data_, scene_.die_site, scene_.goal_site, rules_.rotation_error_unwrapped,
                  scene_.goal_offset);
  now.dropped = now.distance > rules_.drop_distance_m;
  now.solved = now.distance < rules_.position_tolerance_m &&
               now.turn < rules_.rotation_tolerance_rad && !now.dropped;
  return now;
}

// Order and sizes: protocol/tracks/reorientation/layout.cc.
void ReorientationEnvironment::Observe(std::span<double> out) const {
  assert(static_cast<int>(out.size()) == observation_size());
  using Eigen::VectorXd;
  const Official now = official();
  VectorXd::Map(out.data(), std::ssize(out))
      << VectorXd::Map(data_->qpos, kHandJointCount - 1),
      VectorXd::Map(data_->qvel, kHandJointCount) * velocity_scale(), SiteOf(*data_, scene_.die_site),
      SiteOf(*data_, scene_.goal_site), now.position_error, now.rotation, now.goal_rotation,
      now.rotation_error, VectorXd::Map(data_->act, kHandMuscleCount);
}

void ReorientationEnvironment::ObserveExtra(std::span<double> out) const {
  assert(std::ssize(out) == 1 + kHandJointCount);
  out[0] = data_->time;
  std::copy_n(data_->qpos, kHandJointCount, out.begin() + 1);
}

void ReorientationEnvironment::RewardTerms(std::span<double> out) const {
  const Official now = official();
  const int bonus = (now.distance < 2 * rules_.position_tolerance_m) +
                    (now.distance < rules_.position_tolerance_m);
  Eigen::VectorXd::Map(out.data(), std::ssize(out)) << -now.distance, -now.turn, bonus,
      -MuscleEffort(*model_, *data_), -static_cast<double>(now.dropped),
      -now.turn - 10 * now.distance, static_cast<double>(now.solved),
      static_cast<double>(now.dropped);
}

}  // namespace myograde::sim
