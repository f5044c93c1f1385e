#include "tests/sim/reorientation/helpers.h"

#include "protocol/tracks/reorientation/track.h"
#include "sim/reorientation/track.h"
#include "tests/sim/golden.h"
#include "tests/sim/value_or_throw.h"

namespace myograde::sim {

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

std::vector<double> Rewards(const ReorientationEnvironment& env) {
  return Rewards(env, ReorientationTrack());
}

ReorientationFacts FactsOf(const ReorientationEnvironment& env) {
  return std::get<ReorientationFacts>(env.facts().track);
}

}  // namespace myograde::sim
