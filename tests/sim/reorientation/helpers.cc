#include "tests/sim/reorientation/helpers.h"

#include <stdexcept>

#include "sim/reorientation/reorientation.h"
#include "tests/sim/golden.h"

namespace myograde::sim {
namespace {

template <typename T>
T ValueOrThrow(absl::StatusOr<T> value) {
  if (!value.ok()) throw std::runtime_error(value.status().ToString());
  return *std::move(value);
}

}  // namespace

TrackConfig DieConfig() {
  return ValueOrThrow(
      LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "reorientation", "official"));
}

ReorientationRules DieRules() {
  return ValueOrThrow(ParseReorientationRules(DieConfig().rules, "rules"));
}

std::unique_ptr<ReorientationEnvironment> MakeDie(const ReorientationRules& rules) {
  return ValueOrThrow(ReorientationEnvironment::Make(
      rules, ValueOrThrow(LoadModel(ReorientationModel(), CacheDir()))));
}

std::vector<double> Observed(const ReorientationEnvironment& env) {
  std::vector<double> seen(static_cast<size_t>(env.observation_size()));
  env.Observe(seen);
  return seen;
}

std::vector<double> Rewards(const ReorientationEnvironment& env) {
  std::vector<double> terms(ReorientationRewardTerms().size());
  env.RewardTerms(terms);
  return terms;
}

ReorientationFacts FactsOf(const ReorientationEnvironment& env) {
  return std::get<ReorientationFacts>(env.facts().track);
}

}  // namespace myograde::sim
