// Verdicts, aggregates and metrics as JSON, which every answer and receipt has, and boards rank by.
#pragma once

#include <nlohmann/json.hpp>

#include "scoring/aggregate.h"
#include "scoring/board.h"
#include "scoring/track.h"

namespace myograde::scoring {

// The metrics of a judged episode, null where it has none.
nlohmann::json MetricsToJson(const ScoredTrack& track, const Verdict& verdict);

// null if there is no episode.
nlohmann::json AggregateToJson(const ScoredTrack& track, const Aggregate& aggregate);

// The entry of an evaluation with this aggregate; the caller names submission, team, acceptance and
// choice. What it lacks is 0 or none.
BoardEntry EntryOfJson(const ScoredTrack& track, const nlohmann::json& aggregate);

// Whether an aggregate has every number that the track ranks by; one of another version may not.
bool HasRankedNumbers(const ScoredTrack& track, const nlohmann::json& aggregate);

// A metric's description, for those who print its values: name, title, unit, better, digits.
nlohmann::json MetricToJson(const Metric& metric);

// The metrics that the track's results show.
nlohmann::json ShownMetrics(const TrackScoring& scoring);

}  // namespace myograde::scoring
