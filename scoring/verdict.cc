#include "scoring/verdict.h"

namespace myograde::scoring {

std::optional<double> MeanOverSteps(double sum, int64_t steps) {
  if (steps <= 0) return std::nullopt;
  return sum / static_cast<double>(steps);
}

Outcome OutcomeOfFault(const EpisodeFacts& facts) {
  const Outcome outcome = facts.fault.outcome;
  const bool played = outcome == Outcome::kSuccess || outcome == Outcome::kFailure;
  return played ? Outcome::kGraderError : outcome;
}

void SetPlayed(FailureReason reason, Verdict& verdict) {
  verdict.reason = reason;
  verdict.outcome = reason == FailureReason::kNone ? Outcome::kSuccess : Outcome::kFailure;
}

}  // namespace myograde::scoring
