#include "tests/sim/baoding/helpers.h"

#include "protocol/tracks/baoding/track.h"
#include "sim/baoding/track.h"
#include "tests/sim/value_or_throw.h"

namespace myograde::sim {

TrackConfig BallsConfig() {
  return ValueOrThrow(
      LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "baoding", "official"));
}

BaodingRules BallsRules() { return ValueOrThrow(ParseBaodingRules(BallsConfig().rules, "rules")); }

std::unique_ptr<BaodingEnvironment> MakeBalls(const BaodingRules& rules) {
  return ValueOrThrow(
      BaodingEnvironment::Make(rules, ValueOrThrow(LoadModel(BaodingModel(), CacheDir()))));
}

std::vector<double> Rewards(const BaodingEnvironment& env) { return Rewards(env, BaodingTrack()); }

BaodingFacts FactsOf(const BaodingEnvironment& env) {
  return std::get<BaodingFacts>(env.facts().track);
}

}  // namespace myograde::sim
