#include "tests/sim/relocation/helpers.h"

#include "protocol/tracks/relocation/track.h"
#include "sim/relocation/track.h"
#include "tests/sim/value_or_throw.h"

namespace myograde::sim {

TrackConfig ObjectConfig() {
  return ValueOrThrow(
      LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "relocation", "official"));
}

RelocationRules ObjectRules() {
  return ValueOrThrow(ParseRelocationRules(ObjectConfig().rules, "rules"));
}

std::unique_ptr<RelocationEnvironment> MakeObject(const RelocationRules& rules) {
  return ValueOrThrow(
      RelocationEnvironment::Make(rules, ValueOrThrow(LoadModel(RelocationModel(), CacheDir()))));
}

std::vector<double> Rewards(const RelocationEnvironment& env) {
  return Rewards(env, RelocationTrack());
}

RelocationFacts FactsOf(const RelocationEnvironment& env) {
  return std::get<RelocationFacts>(env.facts().track);
}

}  // namespace myograde::sim
