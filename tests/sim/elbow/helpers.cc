#include "tests/sim/elbow/helpers.h"

#include <algorithm>

#include "sim/elbow/track.h"
#include "tests/sim/golden.h"
#include "tests/sim/value_or_throw.h"

namespace myograde::sim {

TrackConfig ElbowConfig(const std::string& profile) {
  return ValueOrThrow(
      LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "elbow", profile));
}

ElbowRules ElbowRulesOf(const std::string& profile) {
  return ValueOrThrow(ParseElbowRules(ElbowConfig(profile).rules, profile));
}

std::unique_ptr<ElbowEnvironment> MakeElbowWith(const ElbowRules& rules) {
  return ValueOrThrow(
      ElbowEnvironment::Make(rules, ValueOrThrow(LoadModel(ElbowModel(), CacheDir()))));
}

std::unique_ptr<ElbowEnvironment> MakeElbowProfile(const std::string& profile) {
  return MakeElbowWith(ElbowRulesOf(profile));
}

ElbowFacts FactsOf(const ElbowEnvironment& env) { return std::get<ElbowFacts>(env.facts().track); }

void PutElbow(ElbowEnvironment& env, double angle) {
  env.data().qpos[0] = angle;
  env.data().qvel[0] = 0;
  env.SynchroniseState();
}

void LoadRecorded(ElbowEnvironment& env, const nlohmann::json& state) {
  mjData& d = env.data();
  d.time = state.at("time").get<double>();
  std::ranges::copy(Doubles(state.at("qpos")), d.qpos);
  std::ranges::copy(Doubles(state.at("qvel")), d.qvel);
  std::ranges::copy(Doubles(state.at("act")), d.act);
  std::ranges::copy(Doubles(state.at("ctrl")), d.ctrl);
  std::ranges::copy(Doubles(state.at("qacc")), d.qacc_warmstart);
  env.SynchroniseState();
}

}  // namespace myograde::sim
