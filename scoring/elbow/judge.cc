#include "scoring/elbow/judge.h"

namespace myograde::scoring {
namespace elbow {
namespace {

bool IsReached(EpisodeEnd end, const ElbowFacts& facts, const ElbowJudging& rules) {
  return rules.success == ElbowSuccess::kHeld ? end == ElbowEnd::kHeld
                                              : facts.solved_steps >= rules.solved_steps;
}

bool CanBe(EpisodeEnd end, const ElbowFacts& facts) {
  if (end == ElbowEnd::kHeld) return facts.held;
  return end == EpisodeEnd::kTime || end == EpisodeEnd::kGivenUp;
}

FailureReason ReasonOf(EpisodeEnd end) {
  return end == EpisodeEnd::kGivenUp ? FailureReason::kGivenUp : FailureReason::kTime;
}

}  // namespace
}  // namespace elbow

Verdict Judge(const EpisodeFacts& episode, const ElbowJudging& rules) {
  using At = ElbowMetric;
  const std::optional<ElbowFacts> facts = FactsOf<ElbowFacts>(episode);
  if (!facts.has_value()) return {};
  Verdict verdict;
  verdict.steps = episode.steps;
  std::vector<std::optional<double>>& metrics = verdict.metrics;
  metrics.resize(At::kCount);
  metrics[At::kTime] = rules.full_time_s;
  metrics[At::kEffort] = MeanOverSteps(facts->effort_sum, episode.steps);
  metrics[At::kEffortSum] = facts->effort_sum;
  metrics[At::kReportedTime] = facts->reported_time;
  metrics[At::kFinalError] = facts->final_error;
  if (episode.end == EpisodeEnd::kFault) {
    verdict.outcome = OutcomeOfFault(episode);
    return verdict;
  }
  if (!elbow::CanBe(episode.end, *facts)) return {};
  const bool reached = elbow::IsReached(episode.end, *facts, rules);
  SetPlayed(reached ? FailureReason::kNone : elbow::ReasonOf(episode.end), verdict);
  if (rules.time == TimeSource::kReported) {
    metrics[At::kTime] = facts->reported_time;
  } else if (reached) {
    metrics[At::kTime] = episode.sim_time;
  }
  return verdict;
}

}  // namespace myograde::scoring
