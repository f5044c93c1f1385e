#include "scoring/baoding/track.h"

namespace myograde::scoring {
namespace baoding {
namespace {

constexpr auto kMetrics = ScoreMetrics({
    {.name = "mean_distance_m", .title = "mean distance", .unit = "m",
     .shown = Metric::Shown::kAlways, .spread = true},
});

absl::StatusOr<TrackScoring> Parse(const nlohmann::json& scoring, const std::string& where) {
  ConfigReader reader(scoring, where);
  BaodingJudging judging;
  judging.horizon_steps = reader.Integer("horizon_steps", 1, 1'000'000);
  judging.solved_steps = reader.Integer("solved_steps", 1, 1'000'000);
  const auto judge = [judging](const EpisodeFacts& facts) { return Judge(facts, judging); };
  return FinishWithScoreBoard(reader, ScoredBaoding(), judge,
                              {ScoreMetric::kScore, ScoreMetric::kEffort});
}

}  // namespace
}  // namespace baoding

Verdict Judge(const EpisodeFacts& episode, const BaodingJudging& rules) {
  return JudgeByScore<BaodingFacts>(episode, [&](const BaodingFacts& facts) {
    const auto solved = static_cast<double>(facts.solved_steps);
    return ScoredEpisode{.score = solved / static_cast<double>(rules.horizon_steps),
                         .success = facts.solved_steps >= rules.solved_steps,
                         .own = {MeanOverSteps(facts.distance_sum, episode.steps)}};
  });
}

const ScoredTrack& ScoredBaoding() {
  static const ScoredTrack track = {.name = BaodingFacts::kTrack,
                                    .metrics = baoding::kMetrics,
                                    .null_metrics = {},
                                    .null_means = {},
                                    .null_spreads = {},
                                    .parse = baoding::Parse};
  return track;
}

}  // namespace myograde::scoring
