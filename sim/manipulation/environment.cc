#include "sim/manipulation/environment.h"

#include <absl/strings/str_cat.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

#include "protocol/base/status_macros.h"
#include "sim/manipulation/track.h"
#include "sim/model/official_steps.h"
#include "sim/model/state.h"

namespace myograde::sim {
namespace {

ManipulationFacts& TrackFacts(EpisodeFacts& facts) {
  return std::get<ManipulationFacts>(facts.track);
}

bool AnyWarning(const mjData& data) {
  return std::any_of(std::begin(data.warning), std::end(data.warning),
                     [](const mjWarningStat& warning) { return warning.number > 0; });
}

}  // namespace

absl::StatusOr<std::unique_ptr<Environment>> MakeManipulation(const TrackConfig& config,
                                                              const std::string& cache_dir) {
  const std::string where = RulesPlace(config);
  auto rules = ParseManipulationRules(config.rules, where);
  if (!rules.ok()) return rules.status();
  if (rules->one_environment &&
      config.episodes_per_lease < static_cast<int64_t>(config.seeds.size())) {
    return absl::InvalidArgumentError(
        absl::StrCat(where, ": one_environment plays every episode in one lease, so "
                     "episodes_per_lease must be at least ", config.seeds.size()));
  }
  ASSIGN_OR_RETURN(auto model, LoadModel(ManipulationModel(), cache_dir));
  return ManipulationEnvironment::Make(*rules, std::move(model));
}

absl::StatusOr<std::unique_ptr<ManipulationEnvironment>> ManipulationEnvironment::Make(
    const ManipulationRules& rules, ModelPtr model) {
  ASSIGN_OR_RETURN(auto scene, FindScene(*model));
  ASSIGN_OR_RETURN(DataPtr data, MakeData(*model));
  return std::unique_ptr<ManipulationEnvironment>(
      new ManipulationEnvironment(rules, std::move(model), std::move(data), scene));
}

ManipulationEnvironment::ManipulationEnvironment(const ManipulationRules& rules, ModelPtr model,
                                                 DataPtr data, const Scene& scene)
    : rules_(rules),
      model_(std::move(model)),
      data_(std::move(data)),
      scene_(scene),
      history_(rules.hold_frames),
      joint_ranges_(*model_, scene.detail_joints) {
  facts_.track = ManipulationFacts{};
}

// ---- Reset ----

void ManipulationEnvironment::Reset(uint64_t seed) {
  const bool carry = rules_.one_environment && played_before_;
  if (!carry) generator_ = NumpyGenerator(seed);
  const bool draw_size = carry || !rules_.size_fixed_on_first_reset;
  variation_ = DrawVariation(rules_, draw_size, generator_);
  ApplyVariation(variation_, rules_, scene_, *model_, *data_);
  if (!carry || !rules_.phantom_trials) solved_flag_ = false;
  played_before_ = true;

  // The official order of evaluation.
  ResetToDefaults(*model_, *data_);
  PlaceAtKeyframe();
  if (!rules_.stale_first_observation) PlaceObjectAtStart();
  mj_forward(model_.get(), data_.get());
  mj_forward(model_.get(), data_.get());
  StartFacts();
  // The official code moves the object only after the observation, so the first
  // physics step uses the keyframe's positions and contacts.
  if (rules_.stale_first_observation) PlaceObjectAtStart();
  derived_are_stale_ = rules_.stale_first_observation;
  start_height_ = ObjectHeight();
  CopyState(*model_, *data_, state_);
}

void ManipulationEnvironment::PlaceAtKeyframe() {
  mju_copy(data_->qpos, model_->key_qpos + kStartKeyframe * model_->nq, model_->nq);
  mju_zero(data_->qvel, model_->nv);
}

void ManipulationEnvironment::PlaceObjectAtStart() {
  auto position = Eigen::Vector3d::Map(data_->qpos + scene_.object_qpos);
  position = variation_.start;
  position.z() += rules_.release_height_m;
}

void ManipulationEnvironment::StartFacts() {
  const double peak_before = TrackFacts(facts_).max_touch;
  const bool keep_peak = rules_.one_environment && rules_.peak_touch_survives_reset;
  facts_ = EpisodeFacts{};
  facts_.track = ManipulationFacts{};
  ManipulationFacts& facts = TrackFacts(facts_);
  if (keep_peak) facts.max_touch = peak_before;  // 0 before the first episode
  history_.Clear();
  goal_touch_ = 0;
  placed_run_ = 0;
  times_ = ObjectTimes();
  counted_frames_ = 0;
  reference_.goal = {variation_.goal.x(), variation_.goal.y(), rules_.goal_face_m};
  reference_.object_height = data_->site_xpos[3 * scene_.touch_site + 2];
  reference_.palm_height = data_->site_xpos[3 * scene_.palm_site + 2];
  RefreshFrame();
  facts.max_touch = std::max(facts.max_touch, data_->sensordata[scene_.touch_sensor]);
  if (rules_.count_reset_frame) history_.Add(touch_);
  history_.Report(facts);
  const OfficialView view = ComputeOfficialView(*data_, scene_);
  facts.final_goal_distance =
      ComputeOfficialReward(*model_, *data_, scene_, view, reference_).goal_dist;
  facts.final_hand_distance = view.reach_error.norm();
}

// ---- Step ----

StepResult ManipulationEnvironment::Step(std::span<const double> action) {
  assert(static_cast<int>(action.size()) == action_size());
  SetControls(action);
  StepResult result = Simulate();
  ++facts_.steps;
  facts_.sim_time = data_->time;
  if (!result.unstable && !result.overflow) {
    CountFrame();
    UpdatePlacement();
    Judge(result);
  }
  CopyState(*model_, *data_, state_);
  return result;
}

void ManipulationEnvironment::SetControls(std::span<const double> action) {
  const bool normalized = convention_ == ActionConvention::kNormalized;
  const auto control = [&](int i, int actuator, bool muscle) {
    const mjtNum* range = model_->actuator_ctrlrange + 2 * actuator;
    double value = action[i];
    if (!rules_.actions_unclipped) {
      value = std::clamp(value, normalized ? -1 : range[0], normalized ? 1 : range[1]);
      facts_.clipped += value != action[i];
    }
    if (normalized) {
      value = muscle ? Excitation(value)
                     : (range[0] + range[1]) / 2 + value * ((range[1] - range[0]) / 2);
    }
    data_->ctrl[actuator] = value;
  };
  for (int i = 0; i < kMuscles; ++i) control(i, scene_.first_muscle + i, true);
  for (int i = 0; i < kServos; ++i) control(kMuscles + i, scene_.first_servo + i, false);
}

StepResult ManipulationEnvironment::Simulate() {
  // Positions, velocities and what follows from them are there from the last
  // evaluation (with a stale first observation: from the keyframe's), so the
  // first integration only needs its second half.
  mj_step2(model_.get(), data_.get());
  derived_are_stale_ = false;
  MeasureForce();
  for (int i = 1; i < kPhysicsSteps; ++i) {
    mj_step(model_.get(), data_.get());
    MeasureForce();
  }
  mj_checkPos(model_.get(), data_.get());
  mj_checkVel(model_.get(), data_.get());
  // The official code evaluates positions twice here, and each time normalises
  // the quaternions in place; the last digit depends on it.
  mj_normalizeQuat(model_.get(), data_->qpos);
  StepResult result;
  result.overflow = Overflown(*data_);
  if (rules_.warnings_reset_simulation && !result.overflow && AnyWarning(*data_)) {
    mj_resetData(model_.get(), data_.get());
  }
  mj_forward(model_.get(), data_.get());
  MeasureForce();
  result.overflow = result.overflow || Overflown(*data_);
  result.unstable = BadNumbers(*data_);
  return result;
}

void ManipulationEnvironment::MeasureForce() {
  ManipulationFacts& facts = TrackFacts(facts_);
  const double force = ObjectForce(*model_, *data_, scene_);
  if (force > facts.peak_force) times_.AddPeak(data_->time);
  facts.peak_force = std::max(facts.peak_force, force);
}

void ManipulationEnvironment::RefreshFrame() {
  touch_ = ObjectTouch(*model_, *data_, scene_, rules_);
}

void ManipulationEnvironment::CountFrame() {
  ManipulationFacts& facts = TrackFacts(facts_);
  RefreshFrame();
  history_.Add(touch_);
  history_.Report(facts);
  times_.AddFrame(data_->time, touch_);
  joint_ranges_.Add(*data_, /*first=*/counted_frames_++ == 0);
  goal_touch_ += touch_[kTouchGoal];
  facts.max_touch = std::max(facts.max_touch, data_->sensordata[scene_.touch_sensor]);
  const OfficialView view = ComputeOfficialView(*data_, scene_);
  const OfficialReward reward =
      ComputeOfficialReward(*model_, *data_, scene_, view, reference_);
  facts.effort_sum += reward.act;
  facts.goal_distance_sum += reward.goal_dist;
  facts.final_goal_distance = reward.goal_dist;
  facts.final_hand_distance = view.reach_error.norm();
  facts.max_height = std::max(facts.max_height, ObjectHeight() - start_height_);
}

Eigen::Vector3d ManipulationEnvironment::ObjectPlace() const {
  const bool centre = rules_.object_point == ManipulationRules::ObjectPoint::kBoxCentre;
  return Eigen::Vector3d::Map(centre ? data_->geom_xpos + 3 * scene_.object_box
                                     : data_->site_xpos + 3 * scene_.touch_site);
}

// Of the box's centre, from the coordinates alone: valid before any forward step.
double ManipulationEnvironment::ObjectHeight() const {
  return ObjectPoint(*data_, scene_, model_->geom_pos + 3 * scene_.object_box).z();
}

void ManipulationEnvironment::UpdatePlacement() {
  const Eigen::Vector3d apart = ObjectPlace() - reference_.goal;
  const bool inside = (apart.array().abs() <= rules_.placed_axis_m).all();
  placed_run_ = inside && TouchesGoalOnly(touch_) ? placed_run_ + 1 : 0;
  TrackFacts(facts_).placed = placed_run_ >= rules_.hold_frames;
}

bool ManipulationEnvironment::EndsSolved(bool solved_before) const {
  switch (rules_.end_rule) {
    case ManipulationRules::EndRule::kPlaced:
      return std::get<ManipulationFacts>(facts_.track).placed;
    case ManipulationRules::EndRule::kSolved:
      return rules_.end_lags_solved ? solved_before : solved_flag_;
  }
  return false;
}

// Official order: time, drop, solved; the limit of steps comes last.
void ManipulationEnvironment::Judge(StepResult& result) {
  ManipulationFacts& facts = TrackFacts(facts_);
  const bool solved_before = std::exchange(
      solved_flag_, facts.final_goal_distance < rules_.solved_distance_m &&
                        goal_touch_ >= rules_.solved_goal_frames);
  facts.solved = solved_flag_;
  facts.solved_steps += solved_flag_;
  facts.reported_time = data_->time;
  result.ended = true;
  if (data_->time > rules_.max_time_s) {
    facts_.end = EpisodeEnd::kTime;
  } else if (ObjectPlace().z() < rules_.drop_height_m) {
    facts_.end = ManipulationEnd::kDropped;
    facts.reported_time = rules_.max_time_s;
  } else if (EndsSolved(solved_before)) {
    // A flag that is older than the episode: left over from the one before.
    const bool phantom = rules_.end_rule == ManipulationRules::EndRule::kSolved &&
                         solved_before && facts_.steps == 1;
    facts_.end = phantom ? ManipulationEnd::kPhantom : ManipulationEnd::kPlaced;
  } else if (facts_.steps >= rules_.max_steps) {
    facts_.end = EpisodeEnd::kTime;
  } else {
    result.ended = false;
  }
}

EpisodeDetails ManipulationEnvironment::details() const {
  if (counted_frames_ == 0) return std::nullopt;
  ManipulationDetails details;
  times_.Report(details);
  details.joint_ranges = joint_ranges_.ranges();
  return details;
}

void ManipulationEnvironment::SynchroniseState() {
  mj_forward(model_.get(), data_.get());
  derived_are_stale_ = false;
  RefreshFrame();
  CopyState(*model_, *data_, state_);
}

// ---- Observation ----

// Order and sizes: protocol/policy/layout.h.
void ManipulationEnvironment::Observe(std::span<double> out) const {
  assert(static_cast<int>(out.size()) == observation_size());
  using Eigen::VectorXd;
  const mjData& d = *data_;
  const OfficialView view = ComputeOfficialView(d, scene_);
  const auto qpos = VectorXd::Map(d.qpos, model_->nq);
  const auto qvel = VectorXd::Map(d.qvel, model_->nv);
  // With a stale first observation, derived quantities are the keyframe's while
  // qpos has the object at its start; the official vector shows the keyframe.
  const mjtNum* shown =
      derived_are_stale_ ? model_->key_qpos + kStartKeyframe * model_->nq : d.qpos;
  VectorXd::Map(out.data(), std::ssize(out)) << d.time, qpos.head(kArmJoints),
      qvel.head(kArmJoints), qpos.segment(kArmJoints, kProsthesisJoints),
      qvel.segment(kArmJoints, kProsthesisJoints), VectorXd::Map(shown + scene_.object_qpos, 7),
      qvel.segment(scene_.object_qvel, 6), VectorXd::Map(d.mocap_pos + 3 * kStartMocap, 3),
      VectorXd::Map(d.mocap_pos + 3 * kGoalMocap, 3),
      Eigen::Array<bool, kContactLabels, 1>::Map(touch_.data()).cast<double>(),
      VectorXd::Map(d.act, kMuscles), view.reach_error, view.pass_error;
}

// Order and sizes: protocol/tracks/manipulation/layout.cc.
void ManipulationEnvironment::ObserveExtra(std::span<double> out) const {
  const OfficialView view = ComputeOfficialView(*data_, scene_);
  Eigen::VectorXd::Map(out.data(), std::ssize(out))
      << std::get<ManipulationFacts>(facts_.track).max_touch, view.palm, view.fingers.reshaped(),
      view.prosthesis_palm, view.prosthesis_orientation, view.prosthesis_orientation_error,
      view.object;
}

void ManipulationEnvironment::RewardTerms(std::span<double> out) const {
  const Official now = official();
  const OfficialReward& reward = now.reward;
  Eigen::VectorXd::Map(out.data(), std::ssize(out))
      << reward.reach_dist, reward.act, reward.fin_open, reward.fin_dis, reward.lift_bonus,
      reward.lift_height, reward.pass_err, 0.0, reward.goal_dist,
      static_cast<double>(now.solved), static_cast<double>(now.done);
}

ManipulationEnvironment::Official ManipulationEnvironment::official() const {
  const ManipulationFacts& facts = std::get<ManipulationFacts>(facts_.track);
  Official official;
  official.view = ComputeOfficialView(*data_, scene_);
  official.reward =
      ComputeOfficialReward(*model_, *data_, scene_, official.view, reference_);
  official.solved = facts.solved;
  official.done = facts_.end != EpisodeEnd::kFault &&
                  !(facts_.end == EpisodeEnd::kTime && data_->time <= rules_.max_time_s);
  official.goal_touch = goal_touch_;
  official.max_force = facts.max_touch;
  official.reported_time = facts.reported_time;
  return official;
}

}  // namespace myograde::sim
