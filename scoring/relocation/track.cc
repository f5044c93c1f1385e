#include "scoring/relocation/track.h"

namespace myograde::scoring {
namespace relocation {
namespace {

constexpr auto kMetrics = ScoreMetrics({
    {.name = "final_position_error_m", .title = "final position error", .unit = "m",
     .shown = Metric::Shown::kAlways, .spread = true},
    {.name = "final_reach_m", .title = "final reach", .unit = "m",
     .shown = Metric::Shown::kAlways, .spread = true},
});

std::vector<std::optional<double>> Own(const RelocationFacts& facts) {
  return {facts.final_position_error, facts.final_reach};
}

}  // namespace
}  // namespace relocation

const ScoredTrack& ScoredRelocation() {
  static const ScoredTrack track = {
      .name = RelocationFacts::kTrack,
      .metrics = relocation::kMetrics,
      .null_metrics = {},
      .null_means = {},
      .null_spreads = {},
      .parse = ParseSolvedSteps<ScoredRelocation, RelocationFacts, relocation::Own>};
  return track;
}

}  // namespace myograde::scoring
