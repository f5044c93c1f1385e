#include "scoring/judge.h"

#include <algorithm>
#include <variant>

namespace myograde::scoring {
namespace {

std::optional<double> MeanOverSteps(double sum, int64_t steps) {
  if (steps <= 0) return std::nullopt;
  return sum / static_cast<double>(steps);
}

Judgement GraderError() { return {}; }

// The facts of one track. A fault that came before the first step may have none, and then
// nothing was measured; a played episode without them is nullopt.
template <typename Facts>
std::optional<Facts> FactsOf(const EpisodeFacts& episode) {
  if (const auto* facts = std::get_if<Facts>(&episode.track)) return *facts;
  if (episode.end == EpisodeEnd::kFault) return Facts();
  return std::nullopt;
}

// The outcome of an episode that was not played to its end. Evidence that names a played
// outcome contradicts itself, which is the grader's doing.
Outcome OutcomeOfFault(const EpisodeFacts& facts) {
  const Outcome outcome = facts.fault.outcome;
  const bool played = outcome == Outcome::kSuccess || outcome == Outcome::kFailure;
  return played ? Outcome::kGraderError : outcome;
}

// What no later step could mend. kNone if there is no such thing.
FailureReason IrreparableCause(const ManipulationFacts& facts, const ManipulationJudging& rules) {
  if (rules.force_enforced && facts.peak_force > rules.force_limit_n) return FailureReason::kForce;
  if (rules.success != SuccessRule::kSolved && facts.frames_other > 0) {
    return FailureReason::kContact;
  }
  return FailureReason::kNone;
}

// Why an episode that reached its end without the goal is a failure.
FailureReason CauseOfEnd(EpisodeEnd end, const ManipulationJudging& rules) {
  if (end == EpisodeEnd::kDropped) return FailureReason::kDropped;
  if (end == EpisodeEnd::kTime) return FailureReason::kTime;
  if (end == EpisodeEnd::kPhantom) return rules.phantom;
  if (end == EpisodeEnd::kGivenUp) return FailureReason::kGivenUp;
  return FailureReason::kHandover;
}

FailureReason CauseOfFailure(const EpisodeFacts& episode, const ManipulationFacts& facts,
                             const ManipulationJudging& rules) {
  if (const FailureReason cause = IrreparableCause(facts, rules); cause != FailureReason::kNone) {
    return cause;
  }
  const bool reached =
      rules.success == SuccessRule::kPlaced ? episode.end == EpisodeEnd::kPlaced : facts.solved;
  if (!reached || episode.end == EpisodeEnd::kDropped) return CauseOfEnd(episode.end, rules);
  if (rules.success == SuccessRule::kSolved) return FailureReason::kNone;
  if (std::min(facts.frames_arm, facts.frames_prosthesis) < rules.contact_frames) {
    return FailureReason::kHandover;
  }
  // Under kPlaced the simulator's end condition already says how the goal was held.
  const bool held = rules.success == SuccessRule::kPlaced || facts.goal_only_at_end;
  return held ? FailureReason::kNone : FailureReason::kHandover;
}

bool IsManipulationEnd(EpisodeEnd end) {
  return end == EpisodeEnd::kTime || end == EpisodeEnd::kPlaced || end == EpisodeEnd::kDropped ||
         end == EpisodeEnd::kPhantom || end == EpisodeEnd::kGivenUp;
}

// The reason that a locomotion end stands for; kNone for a finish, nullopt for an end that the
// track does not have.
std::optional<FailureReason> ReasonOfLocomotionEnd(EpisodeEnd end) {
  switch (end) {
    case EpisodeEnd::kFinished: return FailureReason::kNone;
    case EpisodeEnd::kTime: return FailureReason::kTime;
    case EpisodeEnd::kFell: return FailureReason::kFell;
    case EpisodeEnd::kOffTrack: return FailureReason::kOffTrack;
    case EpisodeEnd::kGivenUp: return FailureReason::kGivenUp;
    default: return std::nullopt;
  }
}

void SetPlayed(FailureReason reason, Judgement& judgement) {
  judgement.reason = reason;
  judgement.outcome = reason == FailureReason::kNone ? Outcome::kSuccess : Outcome::kFailure;
}

}  // namespace

Judgement Judge(const EpisodeFacts& episode, const ManipulationJudging& rules) {
  const std::optional<ManipulationFacts> facts = FactsOf<ManipulationFacts>(episode);
  if (!facts.has_value()) return GraderError();
  Judgement judgement;
  judgement.metrics = {.time = rules.full_time_s,
                       .effort = MeanOverSteps(facts->effort_sum, episode.steps),
                       .pain = std::nullopt,
                       .effort_sum = facts->effort_sum,
                       .reported_time = facts->reported_time,
                       .peak_force = facts->peak_force,
                       .max_touch = facts->max_touch,
                       .steps = episode.steps};
  if (episode.end == EpisodeEnd::kFault) {
    judgement.outcome = OutcomeOfFault(episode);
    return judgement;
  }
  if (!IsManipulationEnd(episode.end)) return GraderError();
  SetPlayed(CauseOfFailure(episode, *facts, rules), judgement);
  if (rules.time == TimeSource::kReported) {
    judgement.metrics.time = facts->reported_time;
  } else if (judgement.outcome == Outcome::kSuccess) {
    judgement.metrics.time = episode.sim_time;
  }
  return judgement;
}

Judgement Judge(const EpisodeFacts& episode, const LocomotionJudging& rules) {
  const std::optional<LocomotionFacts> facts = FactsOf<LocomotionFacts>(episode);
  if (!facts.has_value()) return GraderError();
  Judgement judgement;
  judgement.metrics = {.time = rules.full_time_s,
                       .effort = MeanOverSteps(facts->effort_sum, episode.steps),
                       .pain = MeanOverSteps(facts->pain_sum, episode.steps),
                       .distance = std::clamp(facts->distance, 0.0, rules.course_m),
                       .effort_sum = facts->effort_sum,
                       .pain_sum = facts->pain_sum,
                       .reported_time = facts->reported_time,
                       .steps = episode.steps};
  if (episode.end == EpisodeEnd::kFault) {
    judgement.outcome = OutcomeOfFault(episode);
    return judgement;
  }
  const std::optional<FailureReason> reason = ReasonOfLocomotionEnd(episode.end);
  if (!reason.has_value()) return GraderError();
  SetPlayed(*reason, judgement);
  if (episode.end == EpisodeEnd::kFinished) judgement.metrics.distance = rules.course_m;
  judgement.metrics.time =
      rules.time == TimeSource::kPlayed ? episode.sim_time : facts->reported_time;
  return judgement;
}

}  // namespace myograde::scoring
