#include "scoring/reorientation/track.h"

#include <array>

#include "protocol/base/status_macros.h"
#include "scoring/config.h"

namespace myograde::scoring {
namespace reorientation {
namespace {

using Place = ReorientationMetric;
using Shown = Metric::Shown;

constexpr std::array<Metric, Place::kCount> kMetrics = {{
    {.name = "score", .title = "score", .unit = "", .better = Better::kMore, .ranked = true},
    {.name = "effort", .title = "effort", .unit = "", .better = Better::kLess, .digits = 6,
     .shown = Shown::kAlways, .ranked = true, .spread = true},
    {.name = "effort_sum", .title = "effort sum", .unit = ""},
    {.name = "time_s", .title = "time", .unit = "s"},
    {.name = "final_position_error_m", .title = "final position error", .unit = "m",
     .shown = Shown::kAlways, .spread = true},
    {.name = "final_rotation_error_rad", .title = "final rotation error", .unit = "rad",
     .shown = Shown::kAlways, .spread = true},
}};

std::optional<FailureReason> ReasonOf(EpisodeEnd end) {
  if (end == EpisodeEnd::kTime) return FailureReason::kTime;
  if (end == ReorientationEnd::kDropped) return ReorientationReason::kDropped;
  if (end == EpisodeEnd::kGivenUp) return FailureReason::kGivenUp;
  return std::nullopt;
}

absl::StatusOr<TrackScoring> Parse(const nlohmann::json& scoring, const std::string& where) {
  ConfigReader reader(scoring, where);
  const ReorientationJudging judging = {.solved_steps = reader.Integer("solved_steps", 1, 1'000'000)};
  TrackScoring result;
  result.track = &ScoredReorientation();
  result.judge = [judging](const EpisodeFacts& facts) { return Judge(facts, judging); };
  result.official_figures = true;
  result.team = ReadTeam(reader);
  RETURN_IF_ERROR(reader.Finish());
  result.boards[kMainBoard] = {
      ScoreBoard{.score = RankedPlace(kMetrics, Place::kScore),
                 .effort = RankedPlace(kMetrics, Place::kEffort)},
      {Place::kEffort}};
  return result;
}

}  // namespace
}  // namespace reorientation

Verdict Judge(const EpisodeFacts& episode, const ReorientationJudging& rules) {
  using At = ReorientationMetric;
  const std::optional<ReorientationFacts> facts = FactsOf<ReorientationFacts>(episode);
  if (!facts.has_value()) return {};
  Verdict verdict;
  verdict.steps = episode.steps;
  std::vector<std::optional<double>>& metrics = verdict.metrics;
  metrics.resize(At::kCount);
  metrics[At::kScore] = 0;
  metrics[At::kEffort] = MeanOverSteps(facts->effort_sum, episode.steps);
  metrics[At::kEffortSum] = facts->effort_sum;
  metrics[At::kTime] = episode.sim_time;
  metrics[At::kPositionError] = facts->final_position_error;
  metrics[At::kRotationError] = facts->final_rotation_error;
  if (episode.end == EpisodeEnd::kFault) {
    verdict.outcome = OutcomeOfFault(episode);
    return verdict;
  }
  const std::optional<FailureReason> reason = reorientation::ReasonOf(episode.end);
  if (!reason.has_value()) return {};
  const bool solved = facts->solved_steps >= rules.solved_steps;
  if (solved) metrics[At::kScore] = 1;
  SetPlayed(solved ? FailureReason::kNone : *reason, verdict);
  return verdict;
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
