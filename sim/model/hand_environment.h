// What the environments of the hand, and of the arm with it, have in common beyond their muscles:
// facts and details that each measures, and an end by dropping an object.
#pragma once

#include <optional>
#include <utility>

#include "sim/model/hand.h"
#include "sim/model/joint_ranges.h"
#include "sim/model/muscle_environment.h"
#include "sim/model/official_steps.h"

namespace myograde::sim {

// `joints`: the first of the model, those of the hand or of the arm with it.
template <size_t joints>
class FlaggedEnvironment : public MuscleEnvironment {
 protected:
  FlaggedEnvironment(int physics_steps, const EpisodeRules& rules, ModelPtr model, DataPtr data)
      : MuscleEnvironment(physics_steps, rules, std::move(model), std::move(data)),
        joint_ranges_(*model_) {}

  // As MuscleEnvironment::BeginEpisode.
  void BeginEpisode(const TrackFacts& nothing_measured) {
    MuscleEnvironment::BeginEpisode(nothing_measured);
    solved_time_.reset();
  }

  // Measures the state after a step, whose official flags are given, and ends the episode when it
  // is over. The track's own end is that by dropping.
  template <typename Facts>
  void MeasureFlags(bool solved, bool dropped, StepResult& result) {
    auto& facts = std::get<Facts>(facts_.track);
    joint_ranges_.Add(*data_, measured_steps_ == 1);
    facts.solved = solved;
    facts.solved_steps += solved;
    if (solved && !solved_time_) solved_time_ = data_->time;
    facts.effort_sum += MuscleEffort(*model_, *data_);
    result.ended = dropped || facts_.steps >= episode_rules_.max_steps;
    if (result.ended) facts_.end = dropped ? Facts::kEnds.front() : EpisodeEnd::kTime;
  }

  template <typename Details>
  EpisodeDetails DetailsAs() const {
    if (measured_steps_ == 0) return std::nullopt;
    return Details{{.solved_time = solved_time_, .joint_ranges = joint_ranges_.ranges()}};
  }

 private:
  JointRanges<joints> joint_ranges_;   // of the episode, as what follows
  std::optional<double> solved_time_;  // s, when the flag was up for the first time
};
using HandEnvironment = FlaggedEnvironment<kHandJointCount>;

}  // namespace myograde::sim
