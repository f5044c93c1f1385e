#include "sim/relocation/environment.h"

#include <algorithm>
#include <cassert>
#include <utility>

#include "protocol/base/status_macros.h"
#include "sim/model/official_steps.h"

namespace myograde::sim {

using Eigen::VectorXd;

absl::StatusOr<std::unique_ptr<RelocationEnvironment>> RelocationEnvironment::Make(
    const RelocationRules& rules, ModelPtr model) {
  ASSIGN_OR_RETURN(auto scene, FindRelocationScene(*model));
  ASSIGN_OR_RETURN(DataPtr data, MakeData(*model));
  return std::unique_ptr<RelocationEnvironment>(
      new RelocationEnvironment(rules, std::move(model), std::move(data), scene));
}

RelocationEnvironment::RelocationEnvironment(const RelocationRules& rules, ModelPtr model,
                                             DataPtr data, const RelocationScene& scene)
    : FlaggedEnvironment(kPhysicsSteps, rules, std::move(model), std::move(data)),
      rules_(rules),
      scene_(scene),
      first_observation_(static_cast<size_t>(observation_size())) {
  facts_.track = RelocationFacts{};
  if (!rules_.search_boxes_fixed) return;
  trees_.emplace(*model_, std::vector{scene_.object_body});
  for (int i = 0; i < RelocationVariation::kShapes; ++i) {
    trees_->SetGeomBox(scene_.first_geom + i, rules_.half_size_high_m);
  }
}

void RelocationEnvironment::Reset(uint64_t seed) {
  const ContactSearch search(trees_);
  generator_ = NumpyGenerator(seed);
  draws_ = 0;
  do {
    variation_ = DrawRelocationVariation(rules_, generator_);
    ApplyRelocationVariation(variation_, rules_, scene_, *model_, *data_);
    ResetToDefaults(*model_, *data_);
    // At the second keyframe, each joint of the arm off by the same share of its range. The
    // official code calls it noise, but draws none.
    mju_copy(data_->qpos, model_->key_qpos + model_->nq, model_->nq);
    for (int i = 0; i < kArmJointCount; ++i) {
      const mjtNum* range = model_->jnt_range + 2 * i;
      data_->qpos[i] += rules_.joint_offset * (range[1] - range[0]);
    }
    BeginEpisode(RelocationFacts{});
    if (++draws_ == 1) ObserveState(first_observation_);
  } while (data_->ncon > 0 && draws_ < kMostDraws);
  const Official now = official();
  facts_.track = RelocationFacts{.final_position_error = now.distance,
                                 .smallest_position_error = now.distance,
                                 .final_rotation_error = now.turn,
                                 .final_reach = now.reach,
                                 .smallest_reach = now.reach};
}

void RelocationEnvironment::Measure(StepResult& result) {
  auto& facts = std::get<RelocationFacts>(facts_.track);
  const Official now = official();
  const bool first = measured_steps_ == 1;
  facts.final_position_error = now.distance;
  facts.smallest_position_error =
      first ? now.distance : std::min(facts.smallest_position_error, now.distance);
  facts.final_rotation_error = now.turn;
  facts.final_reach = now.reach;
  facts.smallest_reach = first ? now.reach : std::min(facts.smallest_reach, now.reach);
  MeasureFlags<RelocationFacts>(now.solved, now.dropped, result);
}

RelocationEnvironment::Official RelocationEnvironment::official() const {
  Official now;
  static_cast<PoseError&>(now) =
      PoseErrorOf(*data_, scene_.object_site, scene_.goal_site, rules_.rotation_error_unwrapped);
  now.reach_error = SiteOf(*data_, scene_.palm_site) - SiteOf(*data_, scene_.object_site);
  now.reach = now.reach_error.norm();
  now.dropped = now.reach > rules_.drop_distance_m;
  now.solved = now.distance < rules_.position_tolerance_m && !now.dropped;
  return now;
}

void RelocationEnvironment::Observe(std::span<double> out) const {
  assert(static_cast<int>(out.size()) == observation_size());
  if (facts_.steps == 0 && rules_.first_observation_of_first_draw) {
    std::copy(first_observation_.begin(), first_observation_.end(), out.begin());
  } else {
    ObserveState(out);
  }
}

// Order and sizes: protocol/tracks/relocation/layout.cc.
void RelocationEnvironment::ObserveState(std::span<double> out) const {
  VectorXd::Map(out.data(), std::ssize(out)) << VectorXd::Map(data_->qpos, kArmJointCount - 1),
      VectorXd::Map(data_->qvel, kArmJointCount) * velocity_scale(), ObjectAndGoal(),
      VectorXd::Map(data_->act, kMuscleCount);
}

void RelocationEnvironment::ObserveExtra(std::span<double> out) const {
  VectorXd::Map(out.data(), std::ssize(out)) << data_->time,
      VectorXd::Map(data_->qpos, kArmJointCount), SiteOf(*data_, scene_.palm_site),
      official().reach_error, ObjectAndGoal();
}

Eigen::Vector<double, 18> RelocationEnvironment::ObjectAndGoal() const {
  const Official now = official();
  Eigen::Vector<double, 18> out;
  out << SiteOf(*data_, scene_.object_site), SiteOf(*data_, scene_.goal_site), now.position_error,
      now.rotation, now.goal_rotation, now.rotation_error;
  return out;
}

void RelocationEnvironment::RewardTerms(std::span<double> out) const {
  const Official now = official();
  Eigen::VectorXd::Map(out.data(), std::ssize(out)) << -now.distance, -now.turn,
      -MuscleEffort(*model_, *data_), -now.turn - 10 * now.distance,
      static_cast<double>(now.solved), static_cast<double>(now.dropped);
}

}  // namespace myograde::sim
