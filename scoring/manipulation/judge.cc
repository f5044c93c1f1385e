#include "scoring/manipulation/judge.h"

#include <algorithm>

namespace myograde::scoring {
namespace {

// What no later step could mend. kNone if there is no such thing.
FailureReason IrreparableCause(const ManipulationFacts& facts, const ManipulationJudging& rules) {
  if (rules.force_enforced && facts.peak_force > rules.force_limit_n) {
    return ManipulationReason::kForce;
  }
  if (rules.success != SuccessRule::kSolved && facts.frames_other > 0) {
    return ManipulationReason::kContact;
  }
  return FailureReason::kNone;
}

// Why an episode that reached its end without the goal is a failure.
FailureReason CauseOfEnd(EpisodeEnd end, const ManipulationJudging& rules) {
  if (end == ManipulationEnd::kDropped) return ManipulationReason::kDropped;
  if (end == EpisodeEnd::kTime) return FailureReason::kTime;
  if (end == ManipulationEnd::kPhantom) return rules.phantom;
  if (end == EpisodeEnd::kGivenUp) return FailureReason::kGivenUp;
  return ManipulationReason::kHandover;
}

FailureReason CauseOfFailure(const EpisodeFacts& episode, const ManipulationFacts& facts,
                             const ManipulationJudging& rules) {
  if (const FailureReason cause = IrreparableCause(facts, rules); cause != FailureReason::kNone) {
    return cause;
  }
  const bool reached =
      rules.success == SuccessRule::kPlaced ? episode.end == ManipulationEnd::kPlaced
                                            : facts.solved;
  if (!reached || episode.end == ManipulationEnd::kDropped) return CauseOfEnd(episode.end, rules);
  if (rules.success == SuccessRule::kSolved) return FailureReason::kNone;
  if (std::min(facts.frames_arm, facts.frames_prosthesis) < rules.contact_frames) {
    return ManipulationReason::kHandover;
  }
  // Under kPlaced the simulator's end condition already says how the goal was held.
  const bool held = rules.success == SuccessRule::kPlaced || facts.goal_only_at_end;
  return held ? FailureReason::kNone : ManipulationReason::kHandover;
}

bool IsManipulationEnd(EpisodeEnd end) {
  return end == EpisodeEnd::kTime || end == EpisodeEnd::kGivenUp ||
         end == ManipulationEnd::kPlaced || end == ManipulationEnd::kDropped ||
         end == ManipulationEnd::kPhantom;
}

}  // namespace

Verdict Judge(const EpisodeFacts& episode, const ManipulationJudging& rules) {
  using At = ManipulationMetric;
  const std::optional<ManipulationFacts> facts = FactsOf<ManipulationFacts>(episode);
  if (!facts.has_value()) return {};
  Verdict verdict;
  verdict.steps = episode.steps;
  std::vector<std::optional<double>>& metrics = verdict.metrics;
  metrics.resize(At::kCount);
  metrics[At::kTime] = rules.full_time_s;
  metrics[At::kEffort] = MeanOverSteps(facts->effort_sum, episode.steps);
  metrics[At::kEffortSum] = facts->effort_sum;
  metrics[At::kReportedTime] = facts->reported_time;
  metrics[At::kPeakForce] = facts->peak_force;
  metrics[At::kMaxTouch] = facts->max_touch;
  if (episode.end == EpisodeEnd::kFault) {
    verdict.outcome = OutcomeOfFault(episode);
    return verdict;
  }
  if (!IsManipulationEnd(episode.end)) return {};
  SetPlayed(CauseOfFailure(episode, *facts, rules), verdict);
  if (rules.time == TimeSource::kReported) {
    metrics[At::kTime] = facts->reported_time;
  } else if (verdict.outcome == Outcome::kSuccess) {
    metrics[At::kTime] = episode.sim_time;
  }
  return verdict;
}

}  // namespace myograde::scoring
