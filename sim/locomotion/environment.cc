#include "sim/locomotion/environment.h"

#include <absl/strings/str_cat.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "protocol/base/status_macros.h"
#include "protocol/bridge/leg_sets_json.h"
#include "sim/locomotion/height_map.h"
#include "sim/model/official_steps.h"
#include "sim/model/state.h"

namespace myograde::sim {
namespace {

using Eigen::VectorXd;

constexpr int kSubsteps = 5;
constexpr double kControlPeriod = 0.005;  // s
constexpr int kKeyframes = 3;             // standing, leg behind, leg ahead
constexpr int kKeyframeInSwing = 1;

// The entries of one of MuJoCo's arrays that stand at `indices`. (Eigen's views of this kind take
// the compiler seconds.)
template <size_t n>
Eigen::Matrix<double, n, 1> Pick(const mjtNum* values, const std::array<int, n>& indices) {
  Eigen::Matrix<double, n, 1> picked;
  for (size_t i = 0; i < n; ++i) picked[i] = values[indices[i]];
  return picked;
}

// Replaces the yaw of a root quaternion, keeping its roll and pitch.
void TurnTo(double yaw, double* q) {
  const double w = q[0], x = q[1], y = q[2], z = q[3];
  const double roll = std::atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y));
  const double sine = 2 * (w * y - z * x);
  const double pitch =
      std::abs(sine) >= 1 ? std::copysign(std::numbers::pi / 2, sine) : std::asin(sine);
  using Eigen::AngleAxisd, Eigen::Vector3d;
  const Eigen::Quaterniond turned =
      AngleAxisd(yaw, Vector3d::UnitZ()) *
      (AngleAxisd(pitch, Vector3d::UnitY()) * AngleAxisd(roll, Vector3d::UnitX()));
  VectorXd::Map(q, 4) << turned.w(), turned.x(), turned.y(), turned.z();
}

bool BrokenDown(const mjData& data) {
  return Warned(data, {mjWARN_INERTIA, mjWARN_BADQPOS, mjWARN_BADQVEL, mjWARN_BADQACC,
                       mjWARN_BADCTRL});
}

}  // namespace

absl::StatusOr<std::unique_ptr<LocomotionEnvironment>> LocomotionEnvironment::Make(
    const LocomotionRules& rules, ModelPtr model) {
  ASSIGN_OR_RETURN(auto indices, FindLocomotionIndices(*model));
  if (rules.field.rows * rules.field.columns > model->nhfielddata) {
    return absl::InvalidArgumentError(
        absl::StrCat("rules.field: ", rules.field.rows, " rows of ", rules.field.columns,
                     " columns are more than the model's ", model->nhfielddata, " heights"));
  }
  ASSIGN_OR_RETURN(DataPtr data, MakeData(*model));
  std::unique_ptr<LocomotionEnvironment> out(
      new LocomotionEnvironment(rules, std::move(model), std::move(data), indices));
  return out;
}

LocomotionEnvironment::LocomotionEnvironment(const LocomotionRules& rules, ModelPtr model, DataPtr data,
                       const LocomotionIndices& indices)
    : rules_(rules),
      model_(std::move(model)),
      data_(std::move(data)),
      at_(indices),
      terrain_(rules.field, rules.course, rules.end.distance_from_y_m),
      leg_(rules.leg),
      joint_ranges_(*model_, indices.detail_joints) {
  // The grid's size is part of the rules: the model only reserves room for it.
  model_->hfield_nrow[at_.field] = rules_.field.rows;
  model_->hfield_ncol[at_.field] = rules_.field.columns;
  VectorXd::Map(model_->hfield_size + 4 * at_.field, 3) << rules_.field.half_width_m,
      rules_.field.half_length_m, rules_.field.ceiling_m;
  VectorXd::Map(model_->geom_pos + 3 * at_.field_geom, 3) << 0, 0, rules_.field.offset_m;
  Reset(0);
}

void LocomotionEnvironment::Seed(uint64_t seed) {
  random_.emplace(seed);
  legacy_.emplace(static_cast<uint32_t>(seed));
}

void LocomotionEnvironment::Reset(uint64_t seed) {
  Seed(seed);
  ResetEpisode();
}

void LocomotionEnvironment::LayTerrain() {
  terrain_.Build(*random_, *legacy_);
  // MuJoCo multiplies its samples by the ceiling. With the official ceiling of
  // 1 m, and any power of two, this is exact.
  const auto ceiling = static_cast<float>(rules_.field.ceiling_m);
  float* samples = model_->hfield_data + model_->hfield_adr[at_.field];
  for (const float height : terrain_.heights()) *samples++ = height / ceiling;
}

void LocomotionEnvironment::DrawPose(VectorXd& qpos, VectorXd& qvel) {
  const int key = static_cast<int>(random_->Integers(kKeyframes));
  qpos = VectorXd::Map(model_->key_qpos + key * model_->nq, model_->nq);
  qvel = VectorXd::Map(model_->key_qvel + key * model_->nv, model_->nv);
  leg_.Reset();
  leg_.set_state(key == kKeyframeInSwing ? LegState::kEarlySwing : LegState::kEarlyStance);
  qpos[0] = random_->Uniform(rules_.start.x_low_m, rules_.start.x_high_m);
  qpos[1] = rules_.start.y_m;
  const double yaw = random_->Uniform(Radians(rules_.start.heading_low_deg),
                                      Radians(rules_.start.heading_high_deg));
  TurnTo(yaw, &qpos[3]);
  qvel.head<2>() = Eigen::Vector2d(std::cos(yaw), std::sin(yaw)) * qvel.head<2>().norm();
}

void LocomotionEnvironment::HardReset(const VectorXd& qpos, const VectorXd& qvel) {
  ResetToDefaults(*model_, *data_);
  VectorXd::Map(data_->qpos, model_->nq) = qpos;
  VectorXd::Map(data_->qvel, model_->nv) = qvel;
  // Three times, as the official code: each solution is the next one's start,
  // so that the last bits depend on it.
  for (int i = 0; i < 3; ++i) mj_forward(model_.get(), data_.get());
}

void LocomotionEnvironment::ResetEpisode() {
  LayTerrain();
  VectorXd qpos, qvel;
  DrawPose(qpos, qvel);
  HardReset(qpos, qvel);
  // The lowest foot marker comes to its clearance above the ground plane; the
  // course is level where people start.
  double lowest = data_->site_xpos[3 * at_.foot_sites[0] + 2];
  for (const int site : at_.foot_sites) lowest = std::min(lowest, data_->site_xpos[3 * site + 2]);
  data_->qpos[2] += rules_.start.clearance_m - lowest;
  mj_forward(model_.get(), data_.get());
  // Read back: MuJoCo normalised the quaternion in place.
  qpos = VectorXd::Map(data_->qpos, model_->nq);
  qvel = VectorXd::Map(data_->qvel, model_->nv);
  HardReset(qpos, qvel);
  mj_forward(model_.get(), data_.get());

  facts_ = EpisodeFacts{};
  progress_ = LocomotionFacts{};
  progress_.course = static_cast<int>(terrain_.kind());
  progress_.start_y = rules_.end.distance_from_y_m;
  progress_.min_y = progress_.final_y = root_start_y_ = data_->qpos[1];
  pain_by_joint_.setZero();
  judged_steps_ = 0;
  CopyState(*model_, *data_, state_);
}

absl::Status LocomotionEnvironment::SetParameters(const nlohmann::json& parameters) {
  ASSIGN_OR_RETURN(const LegParameterSets sets, LegSetsFromJson(parameters));
  RETURN_IF_ERROR(leg_.Upload(sets, rules_.leg));
  leg_.Select(leg_.selected());
  return absl::OkStatus();
}

void LocomotionEnvironment::SetState(const State& state) {
  mj_resetData(model_.get(), data_.get());
  data_->time = state.time;
  std::copy(state.qpos.begin(), state.qpos.end(), data_->qpos);
  std::copy(state.qvel.begin(), state.qvel.end(), data_->qvel);
  std::copy(state.act.begin(), state.act.end(), data_->act);
  std::copy(state.ctrl.begin(), state.ctrl.end(), data_->ctrl);
  std::copy(state.warmstart.begin(), state.warmstart.end(), data_->qacc_warmstart);
  mj_forward(model_.get(), data_.get());
  CopyState(*model_, *data_, state_);
}

double LocomotionEnvironment::MuscleControl(double action) {
  const bool normalized = convention_ == ActionConvention::kNormalized;
  if (rules_.clip_actions) {
    const double clipped = std::clamp(action, normalized ? -1.0 : 0.0, 1.0);
    if (clipped != action) ++facts_.clipped;
    action = clipped;
  }
  return normalized ? Excitation(action) : action;
}

void LocomotionEnvironment::SelectLegSet(double action) {
  const double last = rules_.leg.sets - 1;
  const double clipped = std::clamp(action, 0.0, last);
  if (clipped != action && rules_.clip_actions) ++facts_.clipped;
  leg_.Select(static_cast<int>(std::nearbyint(clipped)));
}

LegSensors LocomotionEnvironment::SenseLeg() const {
  return {.load = -data_->sensordata[at_.leg_load + 1],
          .knee_angle = data_->qpos[at_.knee_qpos],
          .knee_velocity = data_->qvel[at_.knee_dof],
          .ankle_angle = data_->qpos[at_.ankle_qpos],
          .ankle_velocity = data_->qvel[at_.ankle_dof]};
}

void LocomotionEnvironment::WriteLegControls(const LegTorques& torques) {
  const double knee = std::clamp(torques.knee / kLegKneeGear, -kLegMotorLimit, kLegMotorLimit);
  const double ankle = std::clamp(torques.ankle / kLegAnkleGear, -kLegMotorLimit, kLegMotorLimit);
  // The official code scales the motors' controls to [-1, 1] when actions are
  // normalised and never back.
  const bool scaled = !rules_.leg.full_torque && convention_ == ActionConvention::kNormalized;
  data_->ctrl[at_.knee_motor] = scaled ? knee / kLegMotorLimit : knee;
  data_->ctrl[at_.ankle_motor] = scaled ? ankle / kLegMotorLimit : ankle;
}

StepResult LocomotionEnvironment::Step(std::span<const double> action) {
  SelectLegSet(action[kLegMuscles]);
  WriteLegControls(leg_.Update(SenseLeg()));
  for (int i = 0; i < kLegMuscles; ++i) data_->ctrl[at_.muscle[i]] = MuscleControl(action[i]);

  // Positions, velocities and what follows from them are there already from
  // the last evaluation, so the first integration only needs its second half.
  mj_step2(model_.get(), data_.get());
  for (int i = 1; i < kSubsteps; ++i) mj_step(model_.get(), data_.get());
  mj_checkPos(model_.get(), data_.get());
  mj_checkVel(model_.get(), data_.get());
  // The official code evaluates positions twice here, and each time normalises
  // the quaternions in place; the last digit depends on it.
  mj_normalizeQuat(model_.get(), data_->qpos);
  StepResult result;
  result.overflow = Overflown(*data_);
  if (rules_.warnings_reset_simulation && !result.overflow && BrokenDown(*data_)) {
    mj_resetData(model_.get(), data_.get());
  }
  mj_forward(model_.get(), data_.get());
  // The official code sees bad accelerations of this evaluation in its next step.
  if (!rules_.warnings_reset_simulation) mj_checkAcc(model_.get(), data_.get());
  ++facts_.steps;
  CopyState(*model_, *data_, state_);

  result.overflow = result.overflow || Overflown(*data_);
  result.unstable = BrokenDown(*data_);
  result.ended = result.overflow || result.unstable;
  if (result.ended) return result;  // facts().end stays kFault
  result.ended = JudgeStep();
  return result;
}

bool LocomotionEnvironment::OffTrack() const {
  return std::abs(data_->qpos[0]) > rules_.end.half_width_m ||
         data_->qpos[1] > rules_.start.y_m + rules_.end.behind_m;
}

bool LocomotionEnvironment::Fallen() const {
  if (!rules_.end.fall_ends) return false;
  const double head = data_->site_xpos[3 * at_.head_site + 2];
  const double feet =
      (data_->xpos[3 * at_.talus_body + 2] + data_->xpos[3 * at_.leg_foot_body + 2]) / 2;
  const double ground = rules_.end.head_reference == HeadReference::kGround
                            ? terrain_.GroundAt(data_->qpos[0], data_->qpos[1])
                            : 0;
  return head - feet < rules_.end.head_above_feet_m || head - ground < rules_.end.head_height_m;
}

LocomotionEnvironment::LimitTorques LocomotionEnvironment::MeasureLimitTorques() const {
  // The rows of the joint limits in the constraint Jacobian (dense for this
  // model) times their forces.
  LimitTorques torque;
  torque.setZero();
  for (int row = 0; row < data_->nefc; ++row) {
    if (data_->efc_type[row] != mjCNSTR_LIMIT_JOINT) continue;
    torque += Pick(data_->efc_J + row * model_->nv, at_.pain_dof) * data_->efc_force[row];
  }
  return torque;
}

LocomotionTerms LocomotionEnvironment::terms() const { return TermsWith(MeasureLimitTorques()); }

LocomotionTerms LocomotionEnvironment::TermsWith(const LimitTorques& torques) const {
  LocomotionTerms out;
  out.effort = VectorXd::Map(data_->act, model_->na).squaredNorm() / kLegMuscles;
  out.pain = (torques.cwiseAbs().cwiseMin(rules_.pain_clip_nm) / 1000).sum() / kPainJoints;
  out.sparse = -data_->qvel[1];
  out.solved = data_->qpos[1] < rules_.end.finish_y_m;
  out.lost = OffTrack() || Fallen();
  return out;
}

void LocomotionEnvironment::RewardTerms(std::span<double> out) const {
  const LocomotionTerms now = terms();
  VectorXd::Map(out.data(), std::ssize(out)) << now.effort, now.pain, now.sparse,
      static_cast<double>(now.solved), static_cast<double>(now.done());
}

int64_t LocomotionEnvironment::MaxSteps() const {
  return std::llround(rules_.end.time_limit_s / kControlPeriod);
}

bool LocomotionEnvironment::JudgeStep() {
  const LimitTorques torques = MeasureLimitTorques();
  const LocomotionTerms now = TermsWith(torques);
  const EndRules& end = rules_.end;
  const double y = data_->qpos[1];
  progress_.effort_sum += now.effort;
  progress_.pain_sum += now.pain;
  pain_by_joint_ += torques.cwiseAbs().cwiseMin(rules_.pain_clip_nm) / 1000;
  joint_ranges_.Add(*data_, /*first=*/judged_steps_++ == 0);
  progress_.min_y = std::min(progress_.min_y, y);
  progress_.final_y = y;
  progress_.distance =
      std::clamp(100 * (end.distance_from_y_m - progress_.min_y) /
                     (end.distance_from_y_m - end.finish_y_m),
                 0.0, 100.0);
  progress_.solved = now.solved;
  progress_.reported_time =
      now.lost && end.lost_reports_time_limit ? end.time_limit_s : data_->time;
  facts_.sim_time = data_->time;
  if (now.solved) {
    facts_.end = LocomotionEnd::kFinished;
  } else if (now.lost) {
    facts_.end = Fallen() ? LocomotionEnd::kFell : LocomotionEnd::kOffTrack;
  } else if (facts_.steps >= MaxSteps()) {
    facts_.end = EpisodeEnd::kTime;
  } else {
    return false;
  }
  return true;
}

EpisodeFacts LocomotionEnvironment::facts() const {
  EpisodeFacts out = facts_;
  out.track = progress_;
  return out;
}

EpisodeDetails LocomotionEnvironment::details() const {
  if (judged_steps_ == 0) return std::nullopt;
  LocomotionDetails out;
  constexpr CourseKind kKinds[] = {CourseKind::kHilly, CourseKind::kRough, CourseKind::kStairs};
  for (size_t i = 0; i < out.obstacle_heights.size(); ++i) {
    out.obstacle_heights[i] = terrain_.HighestPassed(kKinds[i], progress_.min_y);
  }
  LimitTorques::Map(out.pain_by_joint.data()) = pain_by_joint_;
  out.joint_ranges = joint_ranges_.ranges();
  if (facts_.end == LocomotionEnd::kFell) {
    out.fall_time = facts_.sim_time;
    out.fall_y = progress_.final_y;
  }
  // Not by the physics' clock, which a warning may set back.
  out.speed_mean = (root_start_y_ - progress_.final_y) /
                   (static_cast<double>(judged_steps_) * kControlPeriod);
  return out;
}

Eigen::Matrix<double, 3 * kLegMuscles, 1> LocomotionEnvironment::SortedMuscles() const {
  Eigen::Matrix<double, 3 * kLegMuscles, 1> out;
  out << Pick(data_->actuator_length, at_.sorted_muscle),
      Pick(data_->actuator_velocity, at_.sorted_muscle),
      Pick(data_->actuator_force, at_.sorted_muscle) / 1000;
  out.tail(2 * kLegMuscles) = out.tail(2 * kLegMuscles).cwiseMax(-100).cwiseMin(100);
  return out;
}

void LocomotionEnvironment::Observe(std::span<double> out) const {
  const double scale = rules_.observation.velocities_times_step ? kControlPeriod : 1;
  const std::span<double> map = out.last(kHeightMapSize * kHeightMapSize);
  VectorXd::Map(out.data(), std::ssize(out) - std::ssize(map)) << data_->time,
      static_cast<double>(terrain_.kind()), Pick(data_->qpos, at_.joint_qpos),
      Pick(data_->qvel, at_.joint_dof) * scale, data_->sensordata[at_.left_foot_touch],
      data_->sensordata[at_.left_toes_touch], VectorXd::Map(data_->sensordata + at_.socket_load, 3),
      VectorXd::Map(data_->xquat + 4 * at_.pelvis_body, 4), VectorXd::Map(data_->act, kLegMuscles),
      SortedMuscles(), VectorXd::Map(data_->qpos, 2), VectorXd::Map(data_->qvel, 2);
  const Pose pose{VectorXd::Map(data_->qpos, 2), data_->qpos + 3};
  if (rules_.observation.height_map == HeightMapKind::kOfficial) {
    OfficialHeightMap(terrain_, pose, map);
  } else {
    HeadingHeightMap(terrain_, pose, rules_.observation.height_map_pitch_m, map);
  }
}

void LocomotionEnvironment::ObserveOfficial(std::span<double> out) const {
  VectorXd::Map(out.data(), std::ssize(out)) << Pick(data_->qpos, at_.joint_qpos),
      Pick(data_->qvel, at_.joint_dof) * kControlPeriod, data_->sensordata[at_.left_foot_touch],
      data_->sensordata[at_.left_toes_touch], VectorXd::Map(data_->xquat + 4 * at_.pelvis_body, 4),
      VectorXd::Map(data_->qpos, 2), VectorXd::Map(data_->qvel, 2), SortedMuscles(),
      VectorXd::Map(data_->act, kLegMuscles);
}

}  // namespace myograde::sim
