// Implementation of the environment of die reorientation; the tests look inside.
#pragma once

#include <memory>
#include <span>

#include "sim/model/hand_environment.h"
#include "sim/model/pose_error.h"
#include "sim/reorientation/variation.h"

namespace myograde::sim {

class ReorientationEnvironment final : public HandEnvironment {
 public:
  // The official reward, in the order of its dictionary.
  static constexpr RewardTerm kRewardTerms[] = {{"pos_dist", 100}, {"rot_dist", 1}, {"bonus", 0},
                                                {"act_reg", 0},    {"penalty", 0},  {"sparse", 0},
                                                {"solved", 0},     {"done", 0}};
  static constexpr int kPhysicsSteps = 5;  // of 2 ms in a control step

  // InternalError: the model is not that of the hand and the die.
  static absl::StatusOr<std::unique_ptr<ReorientationEnvironment>> Make(
      const ReorientationRules& rules, ModelPtr model);

  void Reset(uint64_t seed) override;
  int observation_size() const override { return 102; }
  void Observe(std::span<double> out) const override;
  void ObserveExtra(std::span<double> out) const override;
  void RewardTerms(std::span<double> out) const override;
  EpisodeDetails details() const override { return DetailsAs<ReorientationDetails>(); }

  // The official quantities of a state.
  struct Official : PoseError {
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
  DieVariation variation_;  // of the episode
};

}  // namespace myograde::sim
