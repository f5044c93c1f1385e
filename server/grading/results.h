// From facts to rows, and from rows to numbers: where scoring meets the store.
#pragma once

#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "scoring/aggregate.h"
#include "scoring/track.h"
#include "server/grading/tracks.h"
#include "server/store/rows.h"

namespace myograde::server {

// The row of an episode, but for its evaluation, lease and attempt.
// InternalError if the facts are not those of a played episode of this track or
// tell of the grader's fault: such an episode is not recorded.
absl::StatusOr<EpisodeRow> JudgedRow(const Track& track, const EpisodeFacts& facts);

// The metrics of a judged episode, with null where the episode has none, and back.
nlohmann::json MetricsToJson(const scoring::ScoredTrack& track,
                             const scoring::Judgement& judgement);
absl::StatusOr<scoring::Judgement> JudgementOf(const scoring::ScoredTrack& track,
                                               const EpisodeRow& row);

// A damaged row (store/damage.h) if one can't be read.
absl::StatusOr<scoring::Aggregate> AggregateRows(const scoring::ScoredTrack& track,
                                                 const std::vector<EpisodeRow>& rows);

// The aggregate as the API tells it; null if there is no episode.
nlohmann::json AggregateToJson(const scoring::ScoredTrack& track,
                               const scoring::Aggregate& aggregate);

// What an evaluation is ranked by: of its aggregate.
Standing StandingOf(const scoring::ScoredTrack& track, const scoring::Aggregate& aggregate);

// A metric for those who print its values: name, title, unit, better, digits.
nlohmann::json MetricToJson(const scoring::Metric& metric);

// Those that results of the track show.
nlohmann::json ShownMetrics(const scoring::TrackScoring& scoring);

// SHA-256 over the canonical results of all rows, in the order of their indices.
std::string ResultsHash(const std::vector<EpisodeRow>& rows);

// The root of the Merkle tree (server/proof/merkle.h) whose leaves are the same canonical rows.
std::string MerkleRootOf(const std::vector<EpisodeRow>& rows);

// What a receipt tells of an episode: its canonical row, and beside it the hashes of its actions
// and of its log.
nlohmann::json ReceiptEntry(const EpisodeRow& row);

}  // namespace myograde::server
