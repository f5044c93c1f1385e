// From facts to rows, and from rows to numbers: where scoring meets the store.
#pragma once

#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "scoring/aggregate.h"
#include "server/daemon/tracks.h"
#include "server/store/rows.h"

namespace myograde::server {

// The row of an episode, but for its evaluation, lease and attempt.
// InternalError if the facts are not those of a played episode of this track or
// tell of the grader's fault: such an episode is not recorded.
absl::StatusOr<EpisodeRow> JudgedRow(const Track& track, const EpisodeFacts& facts);

// The metrics of a judged episode, with null where the track or the episode has
// none, and back.
nlohmann::json MetricsToJson(TrackKind kind, const scoring::Judgement& judgement);
absl::StatusOr<scoring::Judgement> JudgementOf(const EpisodeRow& row);

// DataLossError if a row can't be read.
absl::StatusOr<scoring::Aggregate> AggregateRows(const std::vector<EpisodeRow>& rows);

// The aggregate as the API tells it; null if there is no episode.
nlohmann::json AggregateToJson(TrackKind kind, const scoring::Aggregate& aggregate);

// SHA-256 over the canonical results of all rows, in the order of their indices.
std::string ResultsHash(const std::vector<EpisodeRow>& rows);

// The build of the grader: what the programs that made a result were made of.
nlohmann::json GraderBuild();

}  // namespace myograde::server
