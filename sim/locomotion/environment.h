// The locomotion track: a person with the Open-Source Leg walks a course of
// 100 m. See README.md beside this file for course, controller and profiles.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <mujoco/mujoco.h>

#include "sim/environment.h"
#include "sim/locomotion/indices.h"
#include "sim/locomotion/leg.h"
#include "sim/locomotion/rules.h"
#include "sim/locomotion/terrain.h"
#include "sim/model/joint_ranges.h"
#include "sim/model/model.h"
#include "sim/random/numpy.h"

namespace myograde::sim {

// The official environment's terms of reward for the current state.
struct LocomotionTerms {
  double effort = 0;  // act_reg: mean over the muscles of squared activation
  double pain = 0;    // mean over 12 joints of clipped limit torque, over 1000
  double sparse = 0;  // speed along the course, m/s
  bool solved = false;
  bool lost = false;  // fallen or off track
  bool done() const { return solved || lost; }
  double dense() const { return sparse + (solved ? 10 : 0); }  // the reward
};

class LocomotionEnvironment final : public Environment {
 public:
  // The official reward, in the order of its dictionary.
  static constexpr RewardTerm kRewardTerms[] = {
      {"act_reg", 0}, {"pain", 0}, {"sparse", 1}, {"solved", 10}, {"done", 0}};
  static constexpr int kObservationSize = 365;
  static constexpr int kOfficialObservationSize = 260;
  static constexpr int kActionSize = kLegMuscles + 1;

  static absl::StatusOr<std::unique_ptr<LocomotionEnvironment>> Make(const LocomotionRules& rules,
                                                          ModelPtr model);

  void Reset(uint64_t seed) override;
  // Leg parameter sets, as LegSetsToJson writes them.
  absl::Status SetParameters(const nlohmann::json& parameters) override;
  void SetConvention(ActionConvention convention) override { convention_ = convention; }
  int observation_size() const override { return kObservationSize; }
  int action_size() const override { return kActionSize; }
  void Observe(std::span<double> out) const override;
  StepResult Step(std::span<const double> action) override;
  EpisodeFacts facts() const override;
  EpisodeDetails details() const override;
  std::span<const double> state() const override { return state_; }
  // The official dictionary has nothing beyond the observation.
  void ObserveExtra(std::span<double>) const override {}
  void RewardTerms(std::span<double> out) const override;
  const mjModel& model() const override { return *model_; }
  const mjData& data() const override { return *data_; }

  // What follows is for tests that compare with the official environment,
  // and for trajectories.

  // Seeds both generators; the next ResetEpisode draws from where they are.
  void Seed(uint64_t seed);
  void ResetEpisode();

  // A physics state in the model's own order. What is empty is zero.
  struct State {
    double time = 0;
    std::span<const double> qpos, qvel, act;
    std::span<const double> ctrl;  // what the forces of the leg's sensors were computed with
    std::span<const double> warmstart;
  };
  // Sets the physics state and computes everything that follows from it.
  void SetState(const State& state);

  // The official default observation, 260 entries, before its rounding to
  // single precision.
  void ObserveOfficial(std::span<double> out) const;
  LocomotionTerms terms() const;
  const Terrain& terrain() const { return terrain_; }
  LegController& leg() { return leg_; }
  LegState leg_state() const { return leg_.state(); }
  LegSensors SenseLeg() const;
  const NumpyGenerator& random() const { return *random_; }
  const LocomotionIndices& indices() const { return at_; }
  mjData& data() { return *data_; }

 private:
  LocomotionEnvironment(const LocomotionRules& rules, ModelPtr model, DataPtr data,
             const LocomotionIndices& indices);

  void LayTerrain();
  void HardReset(const Eigen::VectorXd& qpos, const Eigen::VectorXd& qvel);
  void DrawPose(Eigen::VectorXd& qpos, Eigen::VectorXd& qvel);
  // A muscle's control for its action entry, clipped and counted if the rules say so.
  double MuscleControl(double action);
  void SelectLegSet(double action);
  void WriteLegControls(const LegTorques& torques);
  // Adds the step to the facts; true if it was the last.
  bool JudgeStep();
  bool Fallen() const;
  bool OffTrack() const;
  // N m of each joint of pain, from its limits alone.
  using LimitTorques = Eigen::Matrix<double, kPainJoints, 1>;
  LimitTorques MeasureLimitTorques() const;
  LocomotionTerms TermsWith(const LimitTorques& torques) const;
  // The block that both observations share: lengths, velocities and forces of the muscles.
  Eigen::Matrix<double, 3 * kLegMuscles, 1> SortedMuscles() const;
  int64_t MaxSteps() const;

  LocomotionRules rules_;
  ModelPtr model_;
  DataPtr data_;
  LocomotionIndices at_;
  Terrain terrain_;
  LegController leg_;
  ActionConvention convention_ = ActionConvention::kNormalized;
  std::optional<NumpyGenerator> random_;
  std::optional<LegacyNumpyGenerator> legacy_;
  std::vector<double> state_;
  EpisodeFacts facts_;
  LocomotionFacts progress_;

  // What the details need besides.
  JointRanges<LocomotionDetails::kJoints.size()> joint_ranges_;
  Eigen::Matrix<double, kPainJoints, 1> pain_by_joint_;  // sums over steps
  double root_start_y_ = 0;
  int64_t judged_steps_ = 0;
};

}  // namespace myograde::sim
