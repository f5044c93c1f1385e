// Implementation of the environment of relocation; the tests look inside.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "sim/model/hand_environment.h"
#include "sim/model/pose_error.h"
#include "sim/relocation/variation.h"

namespace myograde::sim {

class RelocationEnvironment final
    : public FlaggedEnvironment<std::size(RelocationDetails::kJoints)> {
 public:
  // The official reward, in the order of its dictionary.
  static constexpr RewardTerm kRewardTerms[] = {{"pos_dist", 100}, {"rot_dist", 1}, {"act_reg", 0},
                                                {"sparse", 0},     {"solved", 0},   {"done", 0}};
  static constexpr int kPhysicsSteps = 5;  // of 2 ms in a control step
  static constexpr int kMuscleCount = 63;
  // The first of the model; the object's six follow.
  static constexpr int kArmJointCount = std::size(RelocationDetails::kJoints);
  // A reset draws anew while something touches, at most this often: the official code, which calls
  // itself for it, has to stop somewhere, too.
  static constexpr int kMostDraws = 250;

  // InternalError: the model is not that of the arm, the object and the bin.
  static absl::StatusOr<std::unique_ptr<RelocationEnvironment>> Make(const RelocationRules& rules,
                                                                     ModelPtr model);

  void Reset(uint64_t seed) override;
  int observation_size() const override { return 156; }
  void Observe(std::span<double> out) const override;
  void ObserveExtra(std::span<double> out) const override;
  void RewardTerms(std::span<double> out) const override;
  EpisodeDetails details() const override { return DetailsAs<RelocationDetails>(); }

  // The official quantities of a state.
  struct Official : PoseError {
    Eigen::Vector3d reach_error;  // m, from the object to the palm
    double reach;                 // m, |reach_error|
    bool dropped;
    bool solved;
  };
  Official official() const;
  const RelocationScene& scene() const { return scene_; }
  const RelocationVariation& variation() const { return variation_; }
  int draws() const { return draws_; }  // how often the last reset drew

 private:
  RelocationEnvironment(const RelocationRules& rules, ModelPtr model, DataPtr data,
                        const RelocationScene& scene);
  void ObserveState(std::span<double> out) const;
  Eigen::Vector<double, 18> ObjectAndGoal() const;  // obj_pos to rot_err of the observation
  void Measure(StepResult& result) override;

  RelocationRules rules_;
  RelocationScene scene_;

  // Of the episode.
  RelocationVariation variation_;
  int draws_ = 0;
  std::vector<double> first_observation_;  // of the reset's first draw
};

}  // namespace myograde::sim
