#include "sim/elbow/environment.h"

#include <Eigen/Core>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>
#include <utility>

#include "protocol/base/status_macros.h"
#include "sim/model/official_steps.h"

namespace myograde::sim {
namespace {

ElbowFacts& OfElbow(EpisodeFacts& facts) { return std::get<ElbowFacts>(facts.track); }

}  // namespace

absl::StatusOr<std::unique_ptr<ElbowEnvironment>> ElbowEnvironment::Make(const ElbowRules& rules,
                                                                         ModelPtr model) {
  if (model->nq != 1 || model->nv != 1 || model->nu != kMuscleCount ||
      model->na != kMuscleCount || mj_name2id(model.get(), mjOBJ_JOINT, "r_elbow_flex") != 0 ||
      mj_name2id(model.get(), mjOBJ_ACTUATOR, "TRIlong") != 0) {
    return absl::InternalError("the elbow model does not have the expected joint and muscles");
  }
  ASSIGN_OR_RETURN(DataPtr data, MakeData(*model));
  return std::unique_ptr<ElbowEnvironment>(
      new ElbowEnvironment(rules, std::move(model), std::move(data)));
}

ElbowEnvironment::ElbowEnvironment(const ElbowRules& rules, ModelPtr model, DataPtr data)
    : MuscleEnvironment(kPhysicsSteps, rules, std::move(model), std::move(data)),
      rules_(rules),
      joint_ranges_(*model_, {0}) {
  facts_.track = ElbowFacts{};
}

// ---- Reset ----

// The official order: the target is drawn first, then the start.
void ElbowEnvironment::Reset(uint64_t seed) {
  generator_ = NumpyGenerator(seed);
  target_ = generator_.Uniform(rules_.target_range_rad[0], rules_.target_range_rad[1]);
  const double start = generator_.Uniform(model_->jnt_range[0], model_->jnt_range[1]);
  ResetToDefaults(*model_, *data_);
  data_->qpos[0] = start;
  BeginEpisode(ElbowFacts{.start_angle = start,
                          .target_angle = target_,
                          .final_error = Error(),
                          .smallest_error = Error()});
  run_ = 0;
  settled_.reset();
}

// ---- Step ----

double ElbowEnvironment::Error() const { return std::abs(target_ - data_->qpos[0]); }

void ElbowEnvironment::Measure(StepResult& result) {
  ElbowFacts& facts = OfElbow(facts_);
  const double error = Error();
  facts.final_error = error;
  facts.smallest_error = facts_.steps == 1 ? error : std::min(facts.smallest_error, error);
  facts.error_sum += error;
  const bool within = error <= rules_.tolerance_rad;
  run_ = within ? run_ + 1 : 0;
  if (!within) settled_.reset();
  if (run_ == 1) settled_ = data_->time;
  joint_ranges_.Add(*data_, /*first=*/measured_steps_ == 1);
  facts.tolerance_steps += within;
  facts.longest_run = std::max(facts.longest_run, run_);
  facts.held = facts.longest_run >= rules_.hold_steps;
  facts.solved = error < rules_.solved_distance_rad;
  facts.solved_steps += facts.solved;
  facts.effort_sum += MuscleEffort(*model_, *data_);
  facts.reported_time = data_->time;
  result.ended = true;
  if (rules_.end_rule == ElbowRules::EndRule::kHeld && facts.held) {
    facts_.end = ElbowEnd::kHeld;
  } else if (facts_.steps >= rules_.max_steps) {
    facts_.end = EpisodeEnd::kTime;
  } else {
    result.ended = false;
  }
}

EpisodeDetails ElbowEnvironment::details() const {
  if (measured_steps_ == 0) return std::nullopt;
  ElbowDetails details;
  details.settle_time = settled_;
  details.joint_ranges = joint_ranges_.ranges();
  return details;
}

// ---- Observation ----

// Order and sizes: protocol/tracks/elbow/layout.cc.
void ElbowEnvironment::Observe(std::span<double> out) const {
  assert(static_cast<int>(out.size()) == observation_size());
  Eigen::VectorXd::Map(out.data(), std::ssize(out)) << data_->qpos[0],
      data_->qvel[0] * velocity_scale(), target_ - data_->qpos[0],
      Eigen::VectorXd::Map(data_->act, kMuscleCount);
}

void ElbowEnvironment::ObserveExtra(std::span<double> out) const {
  assert(std::ssize(out) == 1);
  out[0] = data_->time;
}

void ElbowEnvironment::RewardTerms(std::span<double> out) const {
  const Official now = official();
  Eigen::VectorXd::Map(out.data(), std::ssize(out)) << now.pose, now.bonus, now.penalty,
      now.act_reg, now.pose, static_cast<double>(now.solved), static_cast<double>(now.done);
}

ElbowEnvironment::Official ElbowEnvironment::official() const {
  const double error = Error();
  Official official;
  official.pose = -error;
  official.bonus = (error < rules_.solved_distance_rad) +
                   (error < 1.5 * rules_.solved_distance_rad);
  official.done = error > 2 * std::numbers::pi;
  official.penalty = official.done ? -1 : 0;
  official.act_reg = -MuscleEffort(*model_, *data_);
  official.dense = official.pose + 4 * official.bonus + official.act_reg + 50 * official.penalty;
  official.solved = error < rules_.solved_distance_rad;
  return official;
}

}  // namespace myograde::sim
