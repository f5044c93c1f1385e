#include "sim/model/muscle_environment.h"

#include <algorithm>
#include <cassert>
#include <utility>

#include "sim/model/official_steps.h"
#include "sim/model/state.h"

namespace myograde::sim {

MuscleEnvironment::MuscleEnvironment(int physics_steps, const EpisodeRules& rules, ModelPtr model,
                                     DataPtr data)
    : episode_rules_(rules),
      model_(std::move(model)),
      data_(std::move(data)),
      physics_steps_(physics_steps) {}

void MuscleEnvironment::BeginEpisode(const TrackFacts& nothing_measured) {
  Forward(*model_, *data_);
  Forward(*model_, *data_);
  facts_ = EpisodeFacts{};
  facts_.track = nothing_measured;
  measured_steps_ = 0;
  CopyState(*model_, *data_, state_);
}

StepResult MuscleEnvironment::Step(std::span<const double> action) {
  assert(static_cast<int>(action.size()) == action_size());
  SetControls(action);
  const ContactSearch search(trees_);
  StepResult result = PlayControlStep(*model_, *data_, physics_steps_,
                                      episode_rules_.warnings_reset_simulation);
  ++facts_.steps;
  facts_.sim_time = data_->time;
  if (!result.unstable && !result.overflow) {
    ++measured_steps_;
    Measure(result);
  }
  CopyState(*model_, *data_, state_);
  return result;
}

void MuscleEnvironment::SetControls(std::span<const double> action) {
  const bool normalized = convention_ == ActionConvention::kNormalized;
  for (size_t i = 0; i < action.size(); ++i) {
    double value = action[i];
    if (!episode_rules_.actions_unclipped) {
      value = std::clamp(value, normalized ? -1.0 : 0.0, 1.0);
      facts_.clipped += value != action[i];
    }
    data_->ctrl[i] = normalized ? Excitation(value) : value;
  }
}

void MuscleEnvironment::SynchroniseState() {
  const ContactSearch search(trees_);
  Forward(*model_, *data_);
  CopyState(*model_, *data_, state_);
}

}  // namespace myograde::sim
