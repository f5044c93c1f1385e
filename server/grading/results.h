// Converts facts to rows, and rows to numbers: where scoring meets the store.
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

// The row of an episode, without its evaluation, lease and attempt. InternalError if the facts are
// not those of an episode of this track, or report the grader's fault: such an episode is not
// recorded.
absl::StatusOr<EpisodeRow> JudgedRow(const Track& track, const EpisodeFacts& facts);

// The verdict that a row was made of. A damaged row (store/damage.h) if it can't be read.
absl::StatusOr<scoring::Verdict> ReadVerdict(const scoring::ScoredTrack& track,
                                             const EpisodeRow& row);

// Those of rows; errors of ReadVerdict.
absl::StatusOr<std::vector<scoring::JudgedEpisode>> JudgedEpisodes(
    const scoring::ScoredTrack& track, const std::vector<EpisodeRow>& rows);
absl::StatusOr<scoring::Aggregate> AggregateRows(const scoring::ScoredTrack& track,
                                                 const std::vector<EpisodeRow>& rows);

// What an evaluation with these episodes ends as, once all of them are there. Errors of
// AggregateRows.
absl::StatusOr<EvaluationResult> ComputeResult(const Track& track,
                                               const std::vector<EpisodeRow>& rows);

// SHA-256 over the canonical results of all rows, in index order. `seed_salt` is that of the config
// (CanonicalResult).
std::string ResultsHash(const std::vector<EpisodeRow>& rows, const std::string& seed_salt);

// The root of the Merkle tree (server/proof/merkle_tree.h) with the same canonical rows as leaves.
std::string ComputeMerkleRoot(const std::vector<EpisodeRow>& rows, const std::string& seed_salt);

// A receipt's entry for an episode: its canonical row, and the hashes of its actions and its log.
nlohmann::json ReceiptEntry(const EpisodeRow& row, const std::string& seed_salt);

// Adds to the JSON of what a lease used (`policy_cpu_s`, `wall_s`; s) the parts outside of its
// episodes, `startup_cpu_s` and `startup_wall_s`: the policy's start, until it was ready for its
// first episode (of all starts, if it was started again), and its end. The rows of its episodes,
// `first` to `last`, are among `rows`.
void AddStartUp(const std::vector<EpisodeRow>& rows, int64_t first, int64_t last,
                nlohmann::json& use);

}  // namespace myograde::server
