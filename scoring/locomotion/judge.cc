#include "scoring/locomotion/judge.h"

#include <algorithm>

namespace myograde::scoring {
namespace {

// The reason that an end stands for; kNone for a finish, nullopt for an end that the track does
// not have.
std::optional<FailureReason> ReasonOf(EpisodeEnd end) {
  if (end == LocomotionEnd::kFinished) return FailureReason::kNone;
  if (end == EpisodeEnd::kTime) return FailureReason::kTime;
  if (end == LocomotionEnd::kFell) return LocomotionReason::kFell;
  if (end == LocomotionEnd::kOffTrack) return LocomotionReason::kOffTrack;
  if (end == EpisodeEnd::kGivenUp) return FailureReason::kGivenUp;
  return std::nullopt;
}

}  // namespace

Verdict Judge(const EpisodeFacts& episode, const LocomotionJudging& rules) {
  using At = LocomotionMetric;
  const std::optional<LocomotionFacts> facts = FactsOf<LocomotionFacts>(episode);
  if (!facts.has_value()) return {};
  Verdict verdict;
  verdict.steps = episode.steps;
  std::vector<std::optional<double>>& metrics = verdict.metrics;
  metrics.resize(At::kCount);
  metrics[At::kDistance] = std::clamp(facts->distance, 0.0, rules.course_m);
  metrics[At::kTime] = rules.full_time_s;
  metrics[At::kEffort] = MeanOverSteps(facts->effort_sum, episode.steps);
  metrics[At::kPain] = MeanOverSteps(facts->pain_sum, episode.steps);
  metrics[At::kEffortSum] = facts->effort_sum;
  metrics[At::kPainSum] = facts->pain_sum;
  metrics[At::kReportedTime] = facts->reported_time;
  if (episode.end == EpisodeEnd::kFault) {
    verdict.outcome = OutcomeOfFault(episode);
    return verdict;
  }
  const std::optional<FailureReason> reason = ReasonOf(episode.end);
  if (!reason.has_value()) return {};
  SetPlayed(*reason, verdict);
  if (episode.end == LocomotionEnd::kFinished) metrics[At::kDistance] = rules.course_m;
  metrics[At::kTime] =
      rules.time == TimeSource::kPlayed ? episode.sim_time : facts->reported_time;
  return verdict;
}

}  // namespace myograde::scoring
