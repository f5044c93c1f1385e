// Implementation of the manipulation environment; the tests look inside.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "sim/manipulation/rules.h"
#include "sim/environment.h"
#include "sim/manipulation/contacts.h"
#include "sim/manipulation/object_times.h"
#include "sim/manipulation/official.h"
#include "sim/manipulation/scene.h"
#include "sim/manipulation/variation.h"
#include "sim/model/joint_ranges.h"
#include "sim/model/model.h"
#include "sim/random/numpy.h"

namespace myograde::sim {

class ManipulationEnvironment final : public Environment {
 public:
  // The official reward, in the order of its dictionary.
  static constexpr RewardTerm kRewardTerms[] = {
      {"reach_dist", -0.1}, {"act", 0},         {"fin_open", 0},  {"fin_dis", -0.5},
      {"lift_bonus", 0},    {"lift_height", 0}, {"pass_err", -1}, {"sparse", 0},
      {"goal_dist", 0},     {"solved", 0},      {"done", 0}};
  static constexpr int kPhysicsSteps = 5;  // of 2 ms in a control step

  static absl::StatusOr<std::unique_ptr<ManipulationEnvironment>> Make(
      const ManipulationRules& rules, ModelPtr model);

  void Reset(uint64_t seed) override;
  void SetConvention(ActionConvention convention) override { convention_ = convention; }
  int observation_size() const override { return 222; }
  int action_size() const override { return kMuscles + kServos; }
  void Observe(std::span<double> out) const override;
  StepResult Step(std::span<const double> action) override;
  EpisodeFacts facts() const override { return facts_; }
  EpisodeDetails details() const override;
  std::span<const double> state() const override { return state_; }
  void ObserveExtra(std::span<double> out) const override;
  void RewardTerms(std::span<double> out) const override;
  const mjModel& model() const override { return *model_; }
  const mjData& data() const override { return *data_; }

  // What the golden tests compare besides.
  struct Official {
    OfficialView view;
    OfficialReward reward;
    bool solved = false;
    bool done = false;  // the official flag of termination
    int64_t goal_touch = 0;
    double max_force = 0;  // N, running maximum of the touch sensor at control rate
    double reported_time = 0;
  };
  Official official() const;
  const Variation& variation() const { return variation_; }
  const TouchFrame& touch() const { return touch_; }
  const NumpyGenerator& generator() const { return generator_; }
  const Scene& scene() const { return scene_; }
  const RewardReference& reference() const { return reference_; }
  const ManipulationRules& rules() const { return rules_; }
  mjModel& model() { return *model_; }
  mjData& data() { return *data_; }

  // Takes the state in data() for the state after a step or reset: derived
  // quantities are brought up to date and the next step starts from it.
  void SynchroniseState();
  // Recomputes the frame's contacts and sensor without counting them.
  void RefreshFrame();

 private:
  ManipulationEnvironment(const ManipulationRules& rules, ModelPtr model, DataPtr data,
                          const Scene& scene);

  // The parts of a reset.
  void PlaceAtKeyframe();
  void PlaceObjectAtStart();
  void StartFacts();

  // The parts of a step.
  void SetControls(std::span<const double> action);
  StepResult Simulate();
  void MeasureForce();
  void CountFrame();
  void UpdatePlacement();
  void Judge(StepResult& result);
  bool EndsSolved(bool solved_before) const;
  Eigen::Vector3d ObjectPlace() const;
  double ObjectHeight() const;

  ManipulationRules rules_;
  ModelPtr model_;
  DataPtr data_;
  Scene scene_;
  ActionConvention convention_ = ActionConvention::kNormalized;
  NumpyGenerator generator_{0};
  bool played_before_ = false;      // a reset has happened in this environment
  bool derived_are_stale_ = false;  // the next step starts on the keyframe's derived quantities
  bool solved_flag_ = false;        // of the last reward; a reset does not clear it

  // Of the episode.
  Variation variation_ = {};
  RewardReference reference_ = {};
  ContactHistory history_;
  TouchFrame touch_ = {};
  int64_t goal_touch_ = 0;
  int64_t placed_run_ = 0;  // frames in a row in which the object was placed
  double start_height_ = 0;
  EpisodeFacts facts_;
  ObjectTimes times_;
  JointRanges<ManipulationDetails::kJoints.size()> joint_ranges_;
  int64_t counted_frames_ = 0;  // of control steps
  std::vector<double> state_;
};

}  // namespace myograde::sim
