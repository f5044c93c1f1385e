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

absl::StatusOr<TrackScoring> Parse(const nlohmann::json& scoring, const std::string& where) {
  ConfigReader reader(scoring, where);
  const ReorientationJudging judging = {.solved_steps = reader.Integer("solved_steps", 1, 1'000'000)};
  const auto judge = [judging](const EpisodeFacts& facts) { return Judge(facts, judging); };
  return FinishWithScoreBoard(reader, ScoredReorientation(), judge, {ScoreMetric::kEffort});
}

}  // namespace
}  // namespace reorientation

Verdict Judge(const EpisodeFacts& episode, const ReorientationJudging& rules) {
  return JudgeByScore<ReorientationFacts>(episode, [&](const ReorientationFacts& facts) {
    const bool solved = facts.solved_steps >= rules.solved_steps;
    return ScoredEpisode{.score = solved ? 1.0 : 0.0,
                         .success = solved,
                         .own = {facts.final_position_error, facts.final_rotation_error}};
  });
}

const ScoredTrack& ScoredReorientation() {
  static const ScoredTrack track = {.name = ReorientationFacts::kTrack,
                                    .metrics = reorientation::kMetrics,
                                    .null_metrics = {},
                                    .null_means = {},
                                    .null_spreads = {},
                                    .parse = reorientation::Parse};
  return track;
}

}  // namespace myograde::scoring
