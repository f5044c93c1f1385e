#include "scoring/elbow/judge.h"

#include <variant>

namespace myograde::scoring {
namespace {

// Evidence that names a played outcome contradicts itself, which is the grader's doing.
Outcome ElbowFault(const FaultEvidence& fault) {
  const bool played = fault.outcome == Outcome::kSuccess || fault.outcome == Outcome::kFailure;
  return played ? Outcome::kGraderError : fault.outcome;
}

bool ElbowReached(EpisodeEnd end, const ElbowFacts& facts, const ElbowJudging& rules) {
  switch (rules.success) {
    case ElbowSuccess::kHeld: return end == EpisodeEnd::kHeld;
    case ElbowSuccess::kSolved: return facts.solved_steps >= rules.solved_steps;
  }
  return false;
}

bool FitsElbow(EpisodeEnd end, const ElbowFacts& facts) {
  if (end == EpisodeEnd::kHeld) return facts.held;
  return end == EpisodeEnd::kTime || end == EpisodeEnd::kGivenUp;
}

}  // namespace

Judgement Judge(const EpisodeFacts& episode, const ElbowJudging& rules) {
  // A fault that came before the first step may have no facts, and then nothing was measured.
  const auto* measured = std::get_if<ElbowFacts>(&episode.track);
  if (measured == nullptr && episode.end != EpisodeEnd::kFault) return {};
  const ElbowFacts facts = measured == nullptr ? ElbowFacts{} : *measured;
  Judgement judgement;
  judgement.metrics.time = rules.full_time_s;
  if (episode.steps > 0) {
    judgement.metrics.effort = facts.effort_sum / static_cast<double>(episode.steps);
  }
  judgement.metrics.effort_sum = facts.effort_sum;
  judgement.metrics.reported_time = facts.reported_time;
  judgement.metrics.steps = episode.steps;
  if (episode.end == EpisodeEnd::kFault) {
    judgement.outcome = ElbowFault(episode.fault);
    return judgement;
  }
  if (!FitsElbow(episode.end, facts)) return {};
  const bool reached = ElbowReached(episode.end, facts, rules);
  judgement.outcome = reached ? Outcome::kSuccess : Outcome::kFailure;
  if (!reached) {
    judgement.reason = episode.end == EpisodeEnd::kGivenUp ? FailureReason::kGivenUp
                                                           : FailureReason::kTime;
  }
  if (rules.time == TimeSource::kReported) {
    judgement.metrics.time = facts.reported_time;
  } else if (reached) {
    judgement.metrics.time = episode.sim_time;
  }
  return judgement;
}

}  // namespace myograde::scoring
