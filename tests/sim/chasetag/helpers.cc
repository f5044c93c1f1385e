#include "tests/sim/chasetag/helpers.h"

#include "protocol/tracks/chasetag/track.h"
#include "sim/chasetag/track.h"
#include "tests/sim/value_or_throw.h"

namespace myograde::sim {

TrackConfig ChaseConfig() {
  return ValueOrThrow(
      LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "chasetag", "official"));
}

ChaseTagRules ChaseRules() {
  return ValueOrThrow(ParseChaseTagRules(ChaseConfig().rules, "rules"));
}

std::unique_ptr<ChaseTagEnvironment> MakeChase(const ChaseTagRules& rules) {
  return ValueOrThrow(
      ChaseTagEnvironment::Make(rules, ValueOrThrow(LoadModel(ChaseTagModel(), CacheDir()))));
}

std::vector<double> Rewards(const ChaseTagEnvironment& env) {
  return Rewards(env, ChaseTagTrack());
}

ChaseTagFacts FactsOf(const ChaseTagEnvironment& env) {
  return std::get<ChaseTagFacts>(env.facts().track);
}

}  // namespace myograde::sim
