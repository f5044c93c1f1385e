// The verdict on an episode, and what judging has in common on all tracks.
#pragma once

#include <cstdint>
#include <optional>
#include <variant>
#include <vector>

#include "protocol/tracks/episode_facts.h"

namespace myograde::scoring {

// Where the time of an episode that was played to its end comes from.
enum class TimeSource {
  kPlayed,    // simulated time; a track may count a failure as its full time
  kReported,  // what the official code reports
};

struct Verdict {
  Outcome outcome = Outcome::kGraderError;
  FailureReason reason = FailureReason::kNone;
  int64_t steps = 0;  // control steps, which means over steps are of
  // In the order of the track's metrics; none where the episode has none. Empty for
  // kGraderError.
  std::vector<std::optional<double>> metrics;
};

// The mean of a sum over the control steps; none without a step.
std::optional<double> MeanOverSteps(double sum, int64_t steps);

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
Outcome OutcomeOfFault(const EpisodeFacts& facts);

// The outcome of one that was: a success if nothing (kNone) was the reason of a failure.
void SetPlayed(FailureReason reason, Verdict& verdict);

}  // namespace myograde::scoring
