#include "scoring/chasetag/track.h"

#include <cmath>

namespace myograde::scoring {
namespace chasetag {
namespace {

constexpr auto kMetrics = ScoreMetrics({
    {.name = "reported_time_s",
     .title = "reported time",
     .unit = "s",
     .shown = Metric::Shown::kAlways,
     .spread = true},
    {.name = "final_distance_m",
     .title = "final distance",
     .unit = "m",
     .shown = Metric::Shown::kAlways,
     .spread = true},
});

absl::StatusOr<TrackScoring> Parse(const nlohmann::json& scoring, const std::string& where) {
  ConfigReader reader(scoring, where);
  const ChaseTagJudging judging = {.full_time_s = reader.Number("full_time_s", {1e-3, 1e6})};
  const auto judge = [judging](const EpisodeFacts& facts) { return Judge(facts, judging); };
  return FinishWithScoreBoard(reader, ScoredChaseTag(), judge,
                              {ScoreMetric::kScore, ScoreMetric::kEffort});
}

// The sum of the official 'sparse' over the episode, of which only the last step's can be above 0.
double ScoreOf(const EpisodeFacts& episode, const ChaseTagFacts& facts, double full_time_s) {
  const double share = std::nearbyint(episode.sim_time * 100) / 100 / full_time_s;
  if (!facts.evades) return facts.solved ? 1 - share : 0;
  const bool lost = episode.end == ChaseTagEnd::kCaught || episode.end == ChaseTagEnd::kOutOfBounds;
  return facts.solved || lost ? share : 0;
}

}  // namespace
}  // namespace chasetag

Verdict Judge(const EpisodeFacts& episode, const ChaseTagJudging& rules) {
  return JudgeByScore<ChaseTagFacts>(episode, [&](const ChaseTagFacts& facts) {
    return ScoredEpisode{.score = chasetag::ScoreOf(episode, facts, rules.full_time_s),
                         .success = facts.solved,
                         .own = {facts.reported_time, facts.final_distance}};
  });
}

const ScoredTrack& ScoredChaseTag() {
  static const ScoredTrack track = {.name = ChaseTagFacts::kTrack,
                                    .metrics = chasetag::kMetrics,
                                    .null_metrics = {},
                                    .null_means = {},
                                    .null_spreads = {},
                                    .parse = chasetag::Parse};
  return track;
}

}  // namespace myograde::scoring
