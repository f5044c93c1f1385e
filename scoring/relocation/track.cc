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

absl::StatusOr<TrackScoring> Parse(const nlohmann::json& scoring, const std::string& where) {
  ConfigReader reader(scoring, where);
  const RelocationJudging judging = {.solved_steps = reader.Integer("solved_steps", 1, 1'000'000)};
  const auto judge = [judging](const EpisodeFacts& facts) { return Judge(facts, judging); };
  return FinishWithScoreBoard(reader, ScoredRelocation(), judge, {ScoreMetric::kEffort});
}

}  // namespace
}  // namespace relocation

Verdict Judge(const EpisodeFacts& episode, const RelocationJudging& rules) {
  return JudgeByScore<RelocationFacts>(episode, [&](const RelocationFacts& facts) {
    const bool solved = facts.solved_steps >= rules.solved_steps;
    return ScoredEpisode{.score = solved ? 1.0 : 0.0,
                         .success = solved,
                         .own = {facts.final_position_error, facts.final_reach}};
  });
}

const ScoredTrack& ScoredRelocation() {
  static const ScoredTrack track = {.name = RelocationFacts::kTrack,
                                    .metrics = relocation::kMetrics,
                                    .null_metrics = {},
                                    .null_means = {},
                                    .null_spreads = {},
                                    .parse = relocation::Parse};
  return track;
}

}  // namespace myograde::scoring
