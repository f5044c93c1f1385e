// What tracks have in common that rank by a score and then by effort, as the official evaluations of
// 2022 did.
#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "scoring/config.h"
#include "scoring/track.h"

namespace myograde::scoring {

// Places of the first metrics in Verdict::metrics and in the track's list; its own ones follow.
struct ScoreMetric {
  enum Place : size_t {
    kScore,      // by the track's rule; its mean is the official score
    kEffort,     // mean over the steps of |activations| / their number; none without a step
    kEffortSum,  // the same, summed
    kTime,       // s, of simulated time
    kOwn,
  };
};

template <size_t n>
constexpr std::array<Metric, ScoreMetric::kOwn + n> ScoreMetrics(const Metric (&own)[n]) {
  std::array<Metric, ScoreMetric::kOwn + n> metrics = {{
      {.name = "score", .title = "score", .unit = "", .better = Better::kMore, .ranked = true,
       .spread = true},
      {.name = "effort", .title = "effort", .unit = "", .better = Better::kLess, .digits = 6,
       .shown = Metric::Shown::kAlways, .ranked = true, .spread = true},
      {.name = "effort_sum", .title = "effort sum", .unit = ""},
      {.name = "time_s", .title = "time", .unit = "s"},
  }};
  std::ranges::copy(own, metrics.begin() + ScoreMetric::kOwn);
  return metrics;
}

// What a track's rule says of an episode that was played, and its own metrics of any.
struct ScoredEpisode {
  double score;
  bool success;
  std::vector<std::optional<double>> own;
};

// A fault has the outcome that its evidence names, and a score of 0. An episode that was played is
// a success if `rule` says so, however it ended; else it failed by how it ended: time, given-up, or
// the reason in the place of a track's own end; an end beyond the reasons is only that of a
// success. An end that the track does not have is kGraderError. `rule` makes a ScoredEpisode of the
// facts.
template <typename Facts, typename Rule>
Verdict JudgeByScore(const EpisodeFacts& episode, const Rule& rule) {
  const std::optional<Facts> facts = FactsOf<Facts>(episode);
  if (!facts.has_value()) return {};
  const ScoredEpisode scored = rule(*facts);
  Verdict verdict;
  verdict.steps = episode.steps;
  verdict.metrics = {0, MeanOverSteps(facts->effort_sum, episode.steps), facts->effort_sum,
                     episode.sim_time};
  verdict.metrics.insert(verdict.metrics.end(), scored.own.begin(), scored.own.end());
  if (episode.end == EpisodeEnd::kFault) {
    verdict.outcome = OutcomeOfFault(episode);
    return verdict;
  }
  std::optional<FailureReason> reason;
  if (episode.end == EpisodeEnd::kTime) reason = FailureReason::kTime;
  if (episode.end == EpisodeEnd::kGivenUp) reason = FailureReason::kGivenUp;
  for (size_t i = 0; i < Facts::kEnds.size(); ++i) {
    if (episode.end != Facts::kEnds[i]) continue;
    if (i < Facts::kReasons.size()) reason = Facts::kReasons[i];
    if (i >= Facts::kReasons.size() && scored.success) reason = FailureReason::kNone;
  }
  if (!reason.has_value()) return {};
  verdict.metrics[ScoreMetric::kScore] = scored.score;
  SetPlayed(scored.success ? FailureReason::kNone : *reason, verdict);
  return verdict;
}

// Finishes `reader`, from which all but "team" has been read. The board shows the metrics `columns`.
inline absl::StatusOr<TrackScoring> FinishWithScoreBoard(
    ConfigReader& reader, const ScoredTrack& track,
    std::function<Verdict(const EpisodeFacts&)> judge, const std::vector<size_t>& columns) {
  TrackScoring result;
  result.track = &track;
  result.judge = std::move(judge);
  result.official_figures = true;
  result.team = ReadTeam(reader);
  if (auto status = reader.Finish(); !status.ok()) return status;
  result.boards[kMainBoard] = {
      ScoreBoard{.score = RankedPlace(track.metrics, ScoreMetric::kScore),
                 .effort = RankedPlace(track.metrics, ScoreMetric::kEffort)},
      columns};
  return result;
}

// ScoredTrack::parse of a track whose facts count the steps with the official flag: as many as the
// config's "solved_steps" are a success, with a score of 1. `own` gives its own metrics of facts.
template <const ScoredTrack& (*track)(), typename Facts, auto own>
absl::StatusOr<TrackScoring> ParseSolvedSteps(const nlohmann::json& scoring,
                                              const std::string& where) {
  ConfigReader reader(scoring, where);
  const int64_t enough = reader.Integer("solved_steps", 1, 1'000'000);
  const auto judge = [enough](const EpisodeFacts& episode) {
    return JudgeByScore<Facts>(episode, [&](const Facts& facts) {
      const bool solved = facts.solved_steps >= enough;
      return ScoredEpisode{.score = solved ? 1.0 : 0.0, .success = solved, .own = own(facts)};
    });
  };
  return FinishWithScoreBoard(reader, track(), judge, {ScoreMetric::kEffort});
}

}  // namespace myograde::scoring
