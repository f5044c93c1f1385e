#include "sim/chasetag/environment.h"

#include <absl/strings/escaping.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "protocol/base/status_macros.h"
#include "sim/model/finder.h"
#include "sim/model/official_steps.h"

namespace myograde::sim {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int kOpponentPose = 64;  // in the observation

// Ids of the joints after the root's.
constexpr auto kJointIds = [] {
  std::array<int, ChaseTagEnvironment::kJointCount> ids = {};
  std::iota(ids.begin(), ids.end(), 1);
  return ids;
}();

// Half to even, as NumPy rounds.
double ToHundredths(double seconds) { return std::nearbyint(seconds * 100) / 100; }

}  // namespace

absl::StatusOr<ChaseTagScene> FindChaseTagScene(const mjModel& model) {
  Finder finder(model);
  ChaseTagScene scene = {.root_body = finder.Find(mjOBJ_BODY, "root"),
                         .pelvis_body = finder.Find(mjOBJ_BODY, "pelvis"),
                         .right_foot_body = finder.Find(mjOBJ_BODY, "talus_r"),
                         .left_foot_body = finder.Find(mjOBJ_BODY, "talus_l"),
                         .head_site = finder.Find(mjOBJ_SITE, "head"),
                         .field_geom = finder.Find(mjOBJ_GEOM, "terrain"),
                         .touch = {finder.Sensor("r_foot"), finder.Sensor("r_toes"),
                                   finder.Sensor("l_foot"), finder.Sensor("l_toes")},
                         .relief = {}};
  const int relief = finder.Find(mjOBJ_TEXT, "myo_relief");
  RETURN_IF_ERROR(finder.Check("chase-tag"));
  scene.relief = absl::HexStringToBytes(model.text_data + model.text_adr[relief]);
  if (model.nq != 35 || model.nv != 34 || model.nu != 80 || model.na != 80 || model.nkey != 4 ||
      model.nmocap != 1 || model.nhfield != 1 ||
      model.nhfielddata != ChaseTagField::kSamples * ChaseTagField::kSamples ||
      std::ssize(scene.relief) != ChaseTagField::kPatch * ChaseTagField::kPatch ||
      mj_name2id(&model, mjOBJ_JOINT, "hip_flexion_r") != kJointIds.front()) {
    return absl::InternalError(
        "the model of chase-tag does not have the expected joints, muscles and field");
  }
  return scene;
}

absl::StatusOr<std::unique_ptr<ChaseTagEnvironment>> ChaseTagEnvironment::Make(
    const ChaseTagRules& rules, ModelPtr model) {
  ASSIGN_OR_RETURN(auto scene, FindChaseTagScene(*model));
  ASSIGN_OR_RETURN(DataPtr data, MakeData(*model));
  return std::unique_ptr<ChaseTagEnvironment>(
      new ChaseTagEnvironment(rules, std::move(model), std::move(data), scene));
}

ChaseTagEnvironment::ChaseTagEnvironment(const ChaseTagRules& rules, ModelPtr model, DataPtr data,
                                         const ChaseTagScene& scene)
    : MuscleEnvironment(kPhysicsSteps, rules, std::move(model), std::move(data)),
      rules_(rules),
      scene_(scene),
      field_(scene.relief),
      opponent_(rules),
      start_qpos_(static_cast<size_t>(model_->nq)),
      start_qvel_(static_cast<size_t>(model_->nv)),
      first_observation_(static_cast<size_t>(observation_size())),
      joint_ranges_(*model_, kJointIds) {
  facts_.track = ChaseTagFacts{};
  model_->geom_pos[3 * scene_.field_geom + 2] = 0;  // m: the official code lifts it by 5 mm
}

void ChaseTagEnvironment::Reset(uint64_t seed) {
  const ContactSearch search(trees_);
  generator_ = NumpyGenerator(seed);
  field_.Draw(rules_, generator_);
  chases_ = generator_.Integers(2) == 0;
  DrawStart();
  field_.Level(start_qpos_[0], start_qpos_[1], rules_.start_patch_mirrored);
  std::ranges::copy(field_.heights(), model_->hfield_data);
  ResetToDefaults(*model_, *data_);
  std::ranges::copy(start_qpos_, data_->qpos);
  std::ranges::copy(start_qvel_, data_->qvel);
  BeginEpisode(ChaseTagFacts{});
  solved_time_.reset();
  ObserveState(first_observation_);
  const Vector2d root = Vector2d::Map(data_->xpos + 3 * scene_.root_body);
  opponent_.Reset(chases_, root, generator_, *data_);
  // What is shown of the opponent before it was placed is the model's pose, at rest: a new
  // official environment shows the speed of the one step that its construction played.
  first_observation_[kOpponentPose + 3] = first_observation_[kOpponentPose + 4] = 0;
  SynchroniseState();
  const double distance = official().distance;
  facts_.track = ChaseTagFacts{.evades = !chases_,
                               .opponent = static_cast<int>(opponent_.policy()),
                               .final_distance = distance,
                               .smallest_distance = distance};
}

// In mid-step, with either leg in front, somewhere on the field.
void ChaseTagEnvironment::DrawStart() {
  const int key = generator_.Random() < 0.5 ? 2 : 3;
  const mjtNum* qpos = model_->key_qpos + key * model_->nq;
  const mjtNum* qvel = model_->key_qvel + key * model_->nv;
  for (size_t i = 0; i < start_qpos_.size(); ++i) {
    start_qpos_[i] = qpos[i] + generator_.Normal(rules_.start_noise);
  }
  start_qpos_[2] = qpos[2];
  Eigen::Vector4d quaternion =
      Eigen::Vector4d::Map(rules_.orientation_with_noise ? start_qpos_.data() + 3 : qpos + 3);
  for (size_t i = 0; i < 2; ++i)
    start_qpos_[i] = generator_.Uniform(-rules_.start_m, rules_.start_m);
  const double heading = generator_.Uniform(0, 2 * std::numbers::pi);
  quaternion.normalize();
  Rotation rotation;
  mju_quat2Mat(rotation.data(), quaternion.data());
  Vector3d angles = OfficialEulerAngles(rotation);
  angles.z() = heading;
  Eigen::Vector4d::Map(start_qpos_.data() + 3) = OfficialQuaternion(angles);
  std::copy_n(qvel, start_qvel_.size(), start_qvel_.data());
  Vector2d::Map(start_qvel_.data()) =
      Vector2d(std::cos(heading), std::sin(heading)) * Vector2d::Map(qvel).norm();
}

StepResult ChaseTagEnvironment::Step(std::span<const double> action) {
  opponent_.Move(Pelvis(), control_period(), generator_, *data_);
  return MuscleEnvironment::Step(action);
}

Vector2d ChaseTagEnvironment::Pelvis() const {
  return Vector2d::Map(data_->xpos + 3 * scene_.pelvis_body);
}

ChaseTagEnvironment::Official ChaseTagEnvironment::official() const {
  const Vector2d pelvis = Pelvis();
  const auto height = [&](int body) { return data_->xpos[3 * body + 2]; };
  const double feet = (height(scene_.left_foot_body) + height(scene_.right_foot_body)) / 2;
  Official now = {};
  now.distance = (pelvis - Opponent::PoseOf(*data_).head<2>()).norm();
  now.touched = now.distance <= rules_.tag_distance_m;
  now.out = pelvis.cwiseAbs().maxCoeff() > rules_.bounds_m;
  now.fallen = data_->site_xpos[3 * scene_.head_site + 2] - feet < rules_.fall_height_m;
  now.over = data_->time >= rules_.time_limit_s;
  now.solved = chases_ ? now.touched : now.over;
  now.lost = now.out || (chases_ ? now.over || now.fallen : now.touched);
  const double share = ToHundredths(data_->time) / rules_.time_limit_s;
  if (chases_ && now.solved) now.score = 1 - share;
  if (!chases_ && (now.solved || now.lost)) now.score = share;
  return now;
}

void ChaseTagEnvironment::Measure(StepResult& result) {
  auto& facts = std::get<ChaseTagFacts>(facts_.track);
  const Official now = official();
  const bool first = measured_steps_ == 1;
  joint_ranges_.Add(*data_, first);
  facts.final_distance = now.distance;
  facts.smallest_distance = first ? now.distance : std::min(facts.smallest_distance, now.distance);
  facts.solved = now.solved;
  if (now.solved && !solved_time_) solved_time_ = data_->time;
  facts.reported_time = chases_ && now.lost ? rules_.time_limit_s : data_->time;
  facts.effort_sum += MuscleEffort(*model_, *data_);
  result.ended = now.solved || now.lost || facts_.steps >= rules_.max_steps;
  if (!result.ended) return;
  facts_.end = EpisodeEnd::kTime;
  if (now.touched) {
    if (chases_) facts_.end = ChaseTagEnd::kTagged;
    if (!chases_ && !now.solved) facts_.end = ChaseTagEnd::kCaught;
  } else if (chases_ && now.fallen) {
    facts_.end = ChaseTagEnd::kFell;
  } else if (now.out && !now.solved) {
    facts_.end = ChaseTagEnd::kOutOfBounds;
  }
}

EpisodeDetails ChaseTagEnvironment::details() const {
  if (measured_steps_ == 0) return std::nullopt;
  return ChaseTagDetails{{.solved_time = solved_time_, .joint_ranges = joint_ranges_.ranges()}};
}

void ChaseTagEnvironment::Observe(std::span<double> out) const {
  assert(static_cast<int>(out.size()) == observation_size());
  if (facts_.steps == 0 && rules_.first_observation_before_opponent) {
    std::ranges::copy(first_observation_, out.begin());
  } else {
    ObserveState(out);
  }
}

// Order and sizes: protocol/tracks/chasetag/layout.cc.
void ChaseTagEnvironment::ObserveState(std::span<double> out) const {
  Eigen::Vector4d touch;
  for (size_t i = 0; i < scene_.touch.size(); ++i) {
    touch[static_cast<Eigen::Index>(i)] = data_->sensordata[scene_.touch[i]];
  }
  const auto of_muscles = [](const mjtNum* numbers) {
    return Eigen::ArrayXd::Map(numbers, kMuscleCount);
  };
  const auto clipped = [](const auto& numbers) {
    return numbers.max(-100).min(100).matrix().eval();
  };
  VectorXd::Map(out.data(), std::ssize(out)) << VectorXd::Map(data_->qpos + kRootQpos, kJointCount),
      VectorXd::Map(data_->qvel + kRootQvel, kJointCount) * velocity_scale(), touch,
      Eigen::Vector4d::Map(data_->xquat + 4 * scene_.pelvis_body), Opponent::PoseOf(*data_),
      opponent_.velocity(), Vector2d::Map(data_->qpos), Vector2d::Map(data_->qvel),
      of_muscles(data_->actuator_length).matrix(), clipped(of_muscles(data_->actuator_velocity)),
      clipped(of_muscles(data_->actuator_force) / 1000), of_muscles(data_->act).matrix();
}

void ChaseTagEnvironment::ObserveExtra(std::span<double> out) const {
  // In a lost chase the official dictionary says the limit.
  out[0] = measured_steps_ > 0 ? std::get<ChaseTagFacts>(facts_.track).reported_time : data_->time;
  out[1] = chases_ ? 0 : 1;
  OfficialHeightMap(field_.grid(), {Vector2d::Map(data_->qpos), data_->qpos + 3},
                    out.subspan(2, out.size() - 7));
  Eigen::Vector<double, 5>::Map(out.last(5).data()) << Opponent::PoseOf(*data_), opponent_.velocity();
}

void ChaseTagEnvironment::RewardTerms(std::span<double> out) const {
  const Official now = official();
  const Vector2d opponent = Opponent::PoseOf(*data_).head<2>();
  VectorXd::Map(out.data(), std::ssize(out)) << MuscleEffort(*model_, *data_),
      (Vector2d::Map(data_->qpos) - opponent).norm(), static_cast<double>(now.lost), now.score,
      static_cast<double>(now.solved), static_cast<double>(now.solved || now.lost);
}

}  // namespace myograde::sim
