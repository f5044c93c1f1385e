#include "server/api/receipt_view.h"

#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "protocol/lease/policy_seed.h"
#include "server/engine/stored.h"
#include "server/grading/results.h"
#include "server/proof/seed_list.h"
#include "server/store/record.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// The policy seeds that follow from a config; null under form 1, where they follow from the store's
// secret.
Json PolicySeedsOf(const TrackConfig& config, const std::vector<EpisodeRow>& rows) {
  Json seeds;
  if (!config.policy_seed_secret.has_value()) return seeds;
  for (const EpisodeRow& row : rows) {
    seeds.push_back(PolicySeed(*config.policy_seed_secret, row.index));
  }
  return seeds;
}

// Null: this store never had the phase's secret, as after an import.
absl::StatusOr<Json> CommitmentOf(Reader& reader, const std::string& phase) {
  const absl::StatusOr<std::string> secret = reader.PhaseSecret(phase);
  if (absl::IsNotFound(secret.status())) return Json();
  if (!secret.ok()) return secret.status();
  return Json(SecretCommitment(*secret));
}

// Takes everything out of a receipt from which its seeds follow.
absl::Status HideSeeds(Reader& reader, const TrackConfig& config, Json& receipt) {
  ASSIGN_OR_RETURN(Json commitment, CommitmentOf(reader, config.phase));
  receipt["format"] = 2;
  receipt["policy_seeds"] = nullptr;
  for (const char* key : {"seeds", "policy_seed_secret", "seed_salt"}) {
    receipt["track_config"].erase(key);
  }
  receipt["hidden"] = {{"commitment", std::move(commitment)}, {"count", config.seeds.size()}};
  return absl::OkStatus();
}

// The proof is that of the record as its entry left it, so that a receipt stays the same for ever.
// Practice and re-runs have no entry.
absl::Status AddRecord(Reader& reader, RecordLog& record, const EvaluationRow& evaluation,
                       Json& receipt) {
  const absl::StatusOr<RecordRow> entry = reader.GradedEntry(evaluation.id);
  const absl::StatusOr<EntryProof> proof =
      entry.ok() ? record.Prove(reader, entry->index, entry->index + 1)
                 : absl::StatusOr<EntryProof>(entry.status());
  // A broken record does not keep anybody's result back.
  if (absl::IsNotFound(proof.status()) || DamageOf(proof.status())) return absl::OkStatus();
  if (!proof.ok()) return proof.status();
  receipt["record"] = EntryProofToJson(*proof);
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Json> ReceiptOf(Reader& reader, RecordLog& record, const SubmissionRow& submission,
                               const EvaluationRow& evaluation) {
  if (evaluation.state != EvaluationState::kDone && evaluation.state != EvaluationState::kFailed) {
    return absl::FailedPreconditionError(
        absl::StrCat("submission ", submission.id, " is ",
                     std::string(EvaluationStateName(evaluation.state)),
                     "; there is a receipt once it is done or failed"));
  }
  const std::string& hash = ConfigOf(evaluation, submission);
  ASSIGN_OR_RETURN(const std::string config, reader.ConfigJson(hash));
  ASSIGN_OR_RETURN(const TrackConfig track, StoredConfig(reader, hash));
  ASSIGN_OR_RETURN(const std::vector<EpisodeRow> rows, reader.Episodes(evaluation.id));
  const scoring::ScoredTrack& scored = *scoring::FindScoredTrack(track.kind->name);
  ASSIGN_OR_RETURN(scoring::Aggregate aggregate, AggregateRows(scored, rows));
  RETURN_IF_ERROR(CheckResults(reader, evaluation, rows, track.seed_salt));
  Json episodes = Json::array();
  for (const EpisodeRow& row : rows) episodes.push_back(ReceiptEntry(row, track.seed_salt));
  Json receipt = {{"format", 1},
                  {"submission", submission.id},
                  {"evaluation", evaluation.id},
                  {"team", submission.team},
                  {"name", submission.artefact_name},
                  {"track", submission.track},
                  {"track_kind", track.kind->name},
                  {"profile", submission.profile},
                  {"ranked", submission.ranked},
                  {"state", EvaluationStateName(evaluation.state)},
                  {"artefact", ArtefactCommitment(submission.id, submission.artefact)},
                  {"config", hash},
                  {"track_config", Json::parse(config)},
                  {"seeds", SeedsOf(evaluation, submission)},
                  {"policy_seeds", PolicySeedsOf(track, rows)},
                  {"grader", Json::parse(evaluation.grader_json, nullptr, false)},
                  {"aggregate", AggregateToJson(scored, aggregate)},
                  {"results", ResultsHash(rows, track.seed_salt)},
                  {"merkle_root", MerkleRootOf(rows, track.seed_salt)},
                  {"episodes", std::move(episodes)}};
  RETURN_IF_ERROR(AddRecord(reader, record, evaluation, receipt));
  if (track.seed_salt.empty()) return receipt;
  RETURN_IF_ERROR(HideSeeds(reader, track, receipt));
  return receipt;
}

}  // namespace myograde::server
