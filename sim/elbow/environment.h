// Implementation of the elbow environment; the tests look inside.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "sim/elbow/rules.h"
#include "sim/environment.h"
#include "sim/model/joint_ranges.h"
#include "sim/model/model.h"
#include "sim/random/numpy.h"

namespace myograde::sim {

class ElbowEnvironment final : public Environment {
 public:
  static constexpr int kPhysicsSteps = 10;  // of 2 ms in a control step
  static constexpr int kMuscleCount = 6;

  // InternalError: the model is not the elbow's.
  static absl::StatusOr<std::unique_ptr<ElbowEnvironment>> Make(const ElbowRules& rules,
                                                                ModelPtr model);

  void Reset(uint64_t seed) override;
  void SetConvention(ActionConvention convention) override { convention_ = convention; }
  int observation_size() const override { return 3 + kMuscleCount; }
  int action_size() const override { return kMuscleCount; }
  void Observe(std::span<double> out) const override;
  StepResult Step(std::span<const double> action) override;
  EpisodeFacts facts() const override { return facts_; }
  EpisodeDetails details() const override;
  std::span<const double> state() const override { return state_; }
  void ObserveExtra(std::span<double> out) const override;
  void RewardTerms(std::span<double> out) const override;
  const mjModel& model() const override { return *model_; }
  const mjData& data() const override { return *data_; }

  // What the golden tests compare besides: the terms of a step's reward.
  struct Official {
    double pose;     // rad, minus the error
    double bonus;    // 0, 1 or 2: the error is below 1.5 times, and below, solved_distance_rad
    double penalty;  // -1 where the error is above 2 pi, which no angle of the joint reaches
    double act_reg;  // minus |activations| / 6
    double dense;    // the reward
    bool solved;
    bool done;       // as the penalty
  };
  Official official() const;
  double target() const { return target_; }  // rad
  const NumpyGenerator& generator() const { return generator_; }
  const ElbowRules& rules() const { return rules_; }
  mjModel& model() { return *model_; }
  mjData& data() { return *data_; }

  // Takes the state in data() for the state after a step or reset: derived
  // quantities are brought up to date and the next step starts from it.
  void SynchroniseState();

 private:
  ElbowEnvironment(const ElbowRules& rules, ModelPtr model, DataPtr data);

  void StartFromDefaults();
  void StartFacts();
  void SetControls(std::span<const double> action);
  StepResult Simulate();
  void Measure();
  void Judge(StepResult& result);
  double Error() const;   // rad, |target - angle|
  double Effort() const;  // |activations| / 6

  ElbowRules rules_;
  ModelPtr model_;
  DataPtr data_;
  ActionConvention convention_ = ActionConvention::kNormalized;
  NumpyGenerator generator_{0};

  // Of the episode.
  double target_ = 0;  // rad
  int64_t run_ = 0;    // steps in a row within the tolerance
  EpisodeFacts facts_;
  JointRanges<ElbowDetails::kJoints.size()> joint_ranges_;
  int64_t measured_steps_ = 0;
  std::optional<double> settled_;  // s, when the run of steps within the tolerance began
  std::vector<double> state_;
};

}  // namespace myograde::sim
