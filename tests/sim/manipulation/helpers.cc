#include "tests/sim/manipulation/helpers.h"

#include <algorithm>
#include <span>
#include <stdexcept>

#include "protocol/lease/track_config.h"
#include "sim/manipulation/track.h"
#include "tests/sim/golden.h"

namespace myograde::sim {
namespace {

template <typename T>
T OrThrow(absl::StatusOr<T> value) {
  if (!value.ok()) throw std::runtime_error(value.status().ToString());
  return *std::move(value);
}

}  // namespace

ManipulationRules RulesOf(const std::string& profile) {
  const TrackConfig config = OrThrow(
      LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "manipulation", profile));
  return OrThrow(ParseManipulationRules(config.rules, profile));
}

std::unique_ptr<ManipulationEnvironment> MakeEnvironmentWith(const ManipulationRules& rules) {
  return OrThrow(ManipulationEnvironment::Make(
      rules, OrThrow(LoadModel(ManipulationModel(), CacheDir()))));
}

std::unique_ptr<ManipulationEnvironment> MakeProfile(const std::string& profile) {
  return MakeEnvironmentWith(RulesOf(profile));
}

std::vector<double> OfficialControls(ManipulationEnvironment& env) {
  const mjtNum* ctrl = env.data().ctrl;
  std::vector<double> controls(ctrl + env.scene().first_muscle,
                               ctrl + env.scene().first_muscle + kMuscles);
  controls.insert(controls.end(), ctrl + env.scene().first_servo,
                  ctrl + env.scene().first_servo + kServos);
  return controls;
}

void LoadRecordedState(ManipulationEnvironment& env, const nlohmann::json& state) {
  mjData& d = env.data();
  d.time = state.at("time").get<double>();
  std::ranges::copy(Doubles(state.at("qpos")), d.qpos);
  std::ranges::copy(Doubles(state.at("qvel")), d.qvel);
  std::ranges::copy(Doubles(state.at("act")), d.act);
  const auto ctrl = Doubles(state.at("ctrl"));
  std::copy_n(ctrl.begin(), kMuscles, d.ctrl + env.scene().first_muscle);
  std::copy_n(ctrl.begin() + kMuscles, kServos, d.ctrl + env.scene().first_servo);
  const char* const warm = state.contains("qacc_warmstart") ? "qacc_warmstart" : "qacc";
  std::ranges::copy(Doubles(state.at(warm)), d.qacc_warmstart);
  env.SynchroniseState();
}

std::vector<double> OfficialObservation(const ManipulationEnvironment& env) {
  std::vector<double> all(env.observation_size());
  env.Observe(all);
  all.erase(all.begin() + 216, all.end());        // errors of reach and pass
  all.erase(all.begin() + 142, all.begin() + 148);  // start and goal
  return all;
}

bool AnyMeshTouches(ManipulationEnvironment& env) {
  const int* type = env.model().geom_type;
  const std::span<const mjContact> contacts(env.data().contact,
                                            static_cast<size_t>(env.data().ncon));
  return std::ranges::any_of(contacts, [&](const mjContact& contact) {
    return type[contact.geom1] == mjGEOM_MESH || type[contact.geom2] == mjGEOM_MESH;
  });
}

bool AnythingTouchesObject(const ManipulationEnvironment& env) {
  return std::ranges::any_of(env.touch(), [](bool touched) { return touched; });
}

void PutObject(ManipulationEnvironment& env, const Eigen::Vector3d& place) {
  Eigen::Vector3d::Map(env.data().qpos + env.scene().object_qpos) = place;
  mju_zero(env.data().qvel, env.model().nv);
  env.SynchroniseState();
}

}  // namespace myograde::sim
