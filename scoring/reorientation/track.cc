#include "scoring/reorientation/track.h"

namespace myograde::scoring {
namespace reorientation {
namespace {

constexpr auto kMetrics = ScoreMetrics({
    {.name = "final_position_error_m", .title = "final position error", .unit = "m",
     .shown = Metric::Shown::kAlways, .spread = true},
    {.name = "final_rotation_error_rad", .title = "final rotation error", .unit = "rad",
     .shown = Metric::Shown::kAlways, .spread = true},
});

std::vector<std::optional<double>> Own(const ReorientationFacts& facts) {
  return {facts.final_position_error, facts.final_rotation_error};
}

}  // namespace
}  // namespace reorientation

const ScoredTrack& ScoredReorientation() {
  static const ScoredTrack track = {
      .name = ReorientationFacts::kTrack,
      .metrics = reorientation::kMetrics,
      .null_metrics = {},
      .null_means = {},
      .null_spreads = {},
      .parse = ParseSolvedSteps<ScoredReorientation, ReorientationFacts, reorientation::Own>};
  return track;
}

}  // namespace myograde::scoring
