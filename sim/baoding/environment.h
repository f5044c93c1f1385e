// Implementation of the environment of Baoding balls; the tests look inside.
#pragma once

#include <array>
#include <memory>
#include <span>

#include "sim/baoding/variation.h"
#include "sim/model/hand_environment.h"

namespace myograde::sim {

class BaodingEnvironment final : public HandEnvironment {
 public:
  // The official reward, in the order of its dictionary.
  static constexpr RewardTerm kRewardTerms[] = {{"pos_dist_1", 5}, {"pos_dist_2", 5},
                                                {"act_reg", 0},    {"sparse", 0},
                                                {"solved", 0},     {"done", 0}};
  static constexpr int kPhysicsSteps = 10;  // of 2.5 ms in a control step

  // InternalError: the model is not that of the hand and the balls.
  static absl::StatusOr<std::unique_ptr<BaodingEnvironment>> Make(const BaodingRules& rules,
                                                                  ModelPtr model);

  void Reset(uint64_t seed) override;
  StepResult Step(std::span<const double> action) override;
  int observation_size() const override { return 86; }
  void Observe(std::span<double> out) const override;
  void ObserveExtra(std::span<double> out) const override { out[0] = data_->time; }
  void RewardTerms(std::span<double> out) const override;
  EpisodeDetails details() const override { return DetailsAs<BaodingDetails>(); }

  // The official quantities of a state, of the first and of the second ball.
  struct Official {
    std::array<Eigen::Vector3d, 2> errors;  // m, from the ball to its target
    std::array<double, 2> distances;        // m, their lengths
    bool dropped;
    bool solved;
  };
  Official official() const;
  const BallScene& scene() const { return scene_; }
  const BallVariation& variation() const { return variation_; }

 private:
  BaodingEnvironment(const BaodingRules& rules, ModelPtr model, DataPtr data,
                     const BallScene& scene);
  void Measure(StepResult& result) override;
  // Puts the bodies for pictures to where the targets are, without evaluating the state again.
  void ShowTargets();

  BaodingRules rules_;
  BallScene scene_;
  TargetPath first_path_;
  BallVariation variation_;  // of the episode
};

}  // namespace myograde::sim
