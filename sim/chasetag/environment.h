// Implementation of the environment of chase-tag; the tests look inside.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "sim/chasetag/field.h"
#include "sim/chasetag/opponent.h"
#include "sim/model/joint_ranges.h"
#include "sim/model/muscle_environment.h"

namespace myograde::sim {

// Where things are in the model.
struct ChaseTagScene {
  int root_body, pelvis_body, right_foot_body, left_foot_body, head_site, field_geom;
  std::array<int, 4> touch;  // in sensordata, in the order of the observation
  std::string relief;        // bytes, row by row
};

// InternalError names what the model lacks.
absl::StatusOr<ChaseTagScene> FindChaseTagScene(const mjModel& model);

class ChaseTagEnvironment final : public MuscleEnvironment {
 public:
  // The official reward, in the order of its dictionary.
  static constexpr RewardTerm kRewardTerms[] = {{"act_reg", 0}, {"distance", -0.1}, {"lose", -1000},
                                                {"sparse", 0},  {"solved", 0},      {"done", 0}};
  static constexpr int kPhysicsSteps = 10;  // of 1 ms in a control step
  static constexpr int kMuscleCount = 80;
  // After the root's free joint.
  static constexpr int kJointCount = std::size(ChaseTagDetails::kJoints);
  static constexpr int kRootQpos = 7, kRootQvel = 6;  // numbers of the free joint

  // InternalError: the model is not that of the person, the opponent and the field.
  static absl::StatusOr<std::unique_ptr<ChaseTagEnvironment>> Make(const ChaseTagRules& rules,
                                                                   ModelPtr model);

  void Reset(uint64_t seed) override;
  StepResult Step(std::span<const double> action) override;
  int observation_size() const override { return 393; }
  void Observe(std::span<double> out) const override;
  void ObserveExtra(std::span<double> out) const override;
  void RewardTerms(std::span<double> out) const override;
  EpisodeDetails details() const override;

  // The official quantities of a state.
  struct Official {
    double distance;  // m, from the pelvis to the opponent, in the plane
    bool touched;     // the opponent is near enough for a tag
    bool out;         // of bounds
    bool fallen;
    bool over;          // the time limit is reached
    bool solved, lost;  // flags; both may be set
    double score;       // of the state, 'sparse'
  };
  Official official() const;
  bool chases() const { return chases_; }  // the person, in this episode
  const Opponent& opponent() const { return opponent_; }
  const ChaseTagField& field() const { return field_; }
  const ChaseTagScene& scene() const { return scene_; }
  double time_limit() const { return rules_.time_limit_s; }  // s

 private:
  ChaseTagEnvironment(const ChaseTagRules& rules, ModelPtr model, DataPtr data,
                      const ChaseTagScene& scene);
  void DrawStart();
  Eigen::Vector2d Pelvis() const;
  void ObserveState(std::span<double> out) const;
  void Measure(StepResult& result) override;

  ChaseTagRules rules_;
  ChaseTagScene scene_;
  ChaseTagField field_;
  Opponent opponent_;
  std::vector<double> start_qpos_, start_qvel_;

  // Of the episode.
  bool chases_ = true;
  std::vector<double> first_observation_;
  JointRanges<kJointCount> joint_ranges_;
  std::optional<double> solved_time_;  // s, when the flag was up for the first time
};

}  // namespace myograde::sim
