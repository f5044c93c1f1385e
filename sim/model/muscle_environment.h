// What the environments of models that only muscles move have in common.
#pragma once

#include <optional>
#include <vector>

#include "sim/environment.h"
#include "sim/model/contact_search.h"
#include "sim/model/episode_rules.h"
#include "sim/model/model.h"
#include "sim/random/numpy.h"

namespace myograde::sim {

class MuscleEnvironment : public Environment {
 public:
  void SetConvention(ActionConvention convention) override { convention_ = convention; }
  int action_size() const override { return model_->nu; }
  // Measures the state after the step where its numbers are good.
  StepResult Step(std::span<const double> action) override;
  EpisodeFacts facts() const override { return facts_; }
  std::span<const double> state() const override { return state_; }
  const mjModel& model() const override { return *model_; }
  const mjData& data() const override { return *data_; }

  const NumpyGenerator& generator() const { return generator_; }
  mjModel& model() { return *model_; }
  mjData& data() { return *data_; }

  // Takes the state in data() for the state after a step or reset: derived
  // quantities are brought up to date and the next step starts from it.
  void SynchroniseState();

 protected:
  // `physics_steps`: in a control step.
  MuscleEnvironment(int physics_steps, const EpisodeRules& rules, ModelPtr model, DataPtr data);

  double control_period() const { return model_->opt.timestep * physics_steps_; }  // s
  // What observed velocities of joints are multiplied by: the control period, or nothing.
  double velocity_scale() const {
    return episode_rules_.velocities_times_step ? control_period() : 1;
  }

  // The end of a reset, which placed the model in `data`: evaluates the state twice, as the official
  // code does, and clears the facts.
  void BeginEpisode(const TrackFacts& nothing_measured);

  // Adds the state after a step to facts_. Sets `ended`, and the facts' end with it.
  virtual void Measure(StepResult& result) = 0;

  const EpisodeRules episode_rules_;
  ModelPtr model_;
  DataPtr data_;
  NumpyGenerator generator_{0};
  EpisodeFacts facts_;
  int64_t measured_steps_ = 0;  // of the episode
  // By which contacts are searched for in steps; a reset begins a ContactSearch of its own.
  std::optional<BoundingTrees> trees_;

 private:
  void SetControls(std::span<const double> action);

  int physics_steps_;
  ActionConvention convention_ = ActionConvention::kNormalized;
  std::vector<double> state_;
};

}  // namespace myograde::sim
