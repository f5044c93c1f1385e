// Implementation of the elbow environment; the tests look inside.
#pragma once

#include <memory>
#include <optional>
#include <span>

#include "sim/elbow/rules.h"
#include "sim/environment.h"
#include "sim/model/joint_ranges.h"
#include "sim/model/muscle_environment.h"

namespace myograde::sim {

class ElbowEnvironment final : public MuscleEnvironment {
 public:
  // The official reward, in the order of its dictionary.
  static constexpr RewardTerm kRewardTerms[] = {{"pose", 1},    {"bonus", 4},  {"penalty", 50},
                                                {"act_reg", 1}, {"sparse", 0}, {"solved", 0},
                                                {"done", 0}};
  static constexpr int kPhysicsSteps = 10;  // of 2 ms in a control step
  static constexpr int kMuscleCount = 6;

  // InternalError: the model is not the elbow's.
  static absl::StatusOr<std::unique_ptr<ElbowEnvironment>> Make(const ElbowRules& rules,
                                                                ModelPtr model);

  void Reset(uint64_t seed) override;
  int observation_size() const override { return 3 + kMuscleCount; }
  void Observe(std::span<double> out) const override;
  EpisodeDetails details() const override;
  void ObserveExtra(std::span<double> out) const override;
  void RewardTerms(std::span<double> out) const override;

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
  const ElbowRules& rules() const { return rules_; }

 private:
  ElbowEnvironment(const ElbowRules& rules, ModelPtr model, DataPtr data);

  void Measure(StepResult& result) override;
  double Error() const;  // rad, |target - angle|

  ElbowRules rules_;

  // Of the episode.
  double target_ = 0;  // rad
  int64_t run_ = 0;    // steps in a row within the tolerance
  JointRanges<ElbowDetails::kJoints.size()> joint_ranges_;
  std::optional<double> settled_;  // s, when the run of steps within the tolerance began
};

}  // namespace myograde::sim
