// Implementation of the environment of die reorientation; the tests look inside.
#pragma once

#include <memory>
#include <optional>
#include <span>

#include "sim/model/joint_ranges.h"
#include "sim/model/muscle_environment.h"
#include "sim/reorientation/variation.h"

namespace myograde::sim {

class ReorientationEnvironment final : public MuscleEnvironment {
 public:
  static constexpr int kPhysicsSteps = 5;  // of 2 ms in a control step
  static constexpr int kMuscleCount = 39;
  static constexpr int kHandJointCount = 23;  // the first of the model; the die's six follow

  // InternalError: the model is not that of the hand and the die.
  static absl::StatusOr<std::unique_ptr<ReorientationEnvironment>> Make(
      const ReorientationRules& rules, ModelPtr model);

  void Reset(uint64_t seed) override;
  int observation_size() const override { return 102; }
  void Observe(std::span<double> out) const override;
  void ObserveExtra(std::span<double> out) const override;
  void RewardTerms(std::span<double> out) const override;
  EpisodeDetails details() const override;

  // The official quantities of a state.
  struct Official {
    Eigen::Vector3d position_error, rotation, goal_rotation, rotation_error;  // m, rad
    double distance;  // m, |position_error|
    double turn;      // rad, |rotation_error|
    bool dropped;
    bool solved;
  };
  Official official() const;
  const DieScene& scene() const { return scene_; }
  const DieVariation& variation() const { return variation_; }

 private:
  ReorientationEnvironment(const ReorientationRules& rules, ModelPtr model, DataPtr data,
                           DieScene scene);
  void Measure(StepResult& result) override;

  ReorientationRules rules_;
  DieScene scene_;

  // Of the episode.
  DieVariation variation_;
  JointRanges<kHandJointCount> joint_ranges_;
  std::optional<double> solved_time_;  // s, when the flag was up for the first time
};

}  // namespace myograde::sim
