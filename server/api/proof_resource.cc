#include "server/api/resources.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/policy_seed.h"
#include "scoring/aggregate_json.h"
#include "server/api/record_log.h"
#include "server/api/redaction.h"
#include "server/api/requests.h"
#include "server/api/views.h"
#include "server/base/error_code.h"
#include "server/engine/stored.h"
#include "server/grading/results.h"
#include "server/proof/receipt.h"
#include "server/proof/record_head.h"
#include "server/proof/seed_list.h"
#include "server/store/damage.h"
#include "server/store/journal.h"

namespace myograde::server {
namespace {

// The policy seeds that follow from a config.
Json PolicySeedsOf(const TrackConfig& config, const std::vector<EpisodeRow>& rows) {
  Json seeds;
  for (const EpisodeRow& row : rows) {
    seeds.push_back(PolicySeed(config.policy_seed_secret, row.index));
  }
  return seeds;
}

// Null: this store never had the phase's secret, as after an import.
absl::StatusOr<Json> FindCommitment(const Transaction& reader, const std::string& phase) {
  const absl::StatusOr<std::string> secret = reader.phases.Secret(phase);
  if (secret.ok()) return Json(SecretCommitment(*secret));
  return absl::IsNotFound(secret.status()) ? absl::StatusOr<Json>(Json()) : secret.status();
}

// Takes everything out of a receipt from which its seeds follow.
absl::Status HideSeeds(const Transaction& reader, const TrackConfig& config, Json& receipt) {
  ASSIGN_OR_RETURN(Json commitment, FindCommitment(reader, config.phase));
  receipt["format"] = 2;
  receipt["policy_seeds"] = nullptr;
  for (const char* key : {"seeds", "policy_seed_secret", "seed_salt"}) {
    receipt["track_config"].erase(key);
  }
  receipt["hidden"] = {{"commitment", std::move(commitment)}, {"count", config.seeds.size()}};
  return absl::OkStatus();
}

// The proof is that of the record as its entry left it, so that a receipt stays the same for ever.
// Practice and reruns have no entry.
absl::Status AddRecord(const Transaction& reader, RecordLog& record,
                       const EvaluationRow& evaluation, Json& receipt) {
  const absl::StatusOr<RecordRow> entry = reader.journal.GradedEntry(evaluation.id);
  const absl::StatusOr<EntryProof> proof =
      entry.ok() ? record.Prove(reader, entry->index, entry->index + 1)
                 : absl::StatusOr<EntryProof>(entry.status());
  // A broken record does not keep anybody's result back.
  if (absl::IsNotFound(proof.status()) || ExtractDamage(proof.status())) return absl::OkStatus();
  if (!proof.ok()) return proof.status();
  receipt["record"] = EntryProofToJson(*proof);
  return absl::OkStatus();
}

// Everything that the result of a submission's evaluation is a function of, and the result
// (server/proof/receipt.h); in format 2 if its config hides its seeds, whether or not they have
// been revealed. `record` proves where the public record has it. FailedPreconditionError before it
// is done or failed.
absl::StatusOr<Json> BuildReceipt(const Transaction& reader, RecordLog& record,
                                  const SubmissionRow& submission,
                                  const EvaluationRow& evaluation) {
  if (evaluation.state != EvaluationState::kDone && evaluation.state != EvaluationState::kFailed) {
    return absl::FailedPreconditionError(
        absl::StrCat("submission ", submission.id, " is ", std::string(EnumName(evaluation.state)),
                     "; it has a receipt once it is done or failed"));
  }
  const std::string& hash = evaluation.config;
  ASSIGN_OR_RETURN(const std::string config, reader.content.Text(kConfigs, hash));
  ASSIGN_OR_RETURN(const TrackPtr stored, StoredTrack(reader, hash));
  const TrackConfig& track = stored->config;
  ASSIGN_OR_RETURN(const std::vector<EpisodeRow> rows, reader.episodes.Of(evaluation.id));
  const scoring::ScoredTrack& scored = *stored->scoring.track;
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
                  {"state", EnumName(evaluation.state)},
                  {"artefact", ArtefactCommitment(submission.id, submission.artefact)},
                  {"config", hash},
                  {"track_config", Json::parse(config)},
                  {"seeds", evaluation.seeds},
                  {"policy_seeds", PolicySeedsOf(track, rows)},
                  {"grader", ParsedText(evaluation.grader_json)},
                  {"aggregate", AggregateToJson(scored, aggregate)},
                  {"results", ResultsHash(rows, track.seed_salt)},
                  {"merkle_root", ComputeMerkleRoot(rows, track.seed_salt)},
                  {"episodes", std::move(episodes)}};
  RETURN_IF_ERROR(AddRecord(reader, record, evaluation, receipt));
  if (track.seed_salt.empty()) return receipt;
  RETURN_IF_ERROR(HideSeeds(reader, track, receipt));
  return receipt;
}

// A receipt lists the result of each episode, so a phase that withholds those withholds it as a
// whole. `everybody`: whoever the caller is, it is to be published.
absl::Status CheckReceiptShown(const Transaction& reader, const ApiContext& context,
                               const SubmissionRow& submission, bool everybody) {
  const bool shown = everybody ? IsPhasePublic(reader, context, submission.phase)
                               : SeesReceipt(FindPhaseVisibility(reader, context, submission.phase));
  if (shown) return absl::OkStatus();
  return WithheldError(absl::StrCat("the receipt of submission ", submission.id,
                                    " lists the "
                                    "result of each episode, which phase \"",
                                    submission.phase, "\" withholds"));
}

// Of a failed submission, a phase that withholds anything shows no single episode (redaction.h).
absl::Status CheckFailureShown(const Transaction& reader, const ApiContext& context,
                               const SubmissionRow& submission) {
  if (FindPhaseVisibility(reader, context, submission.phase).progress) return absl::OkStatus();
  return WithheldError(absl::StrCat("submission ", submission.id,
                                    " failed, and its receipt lists how "
                                    "each episode ended, which phase \"",
                                    submission.phase, "\" withholds"));
}

// The evaluation that the request asks for; without one, the submission's original.
absl::StatusOr<EvaluationRow> AskedEvaluation(const Request& request, const Transaction& reader,
                                              int64_t submission) {
  int64_t id = 0;
  RETURN_IF_ERROR(ReadNumber(request, "evaluation", INT64_MAX, id));
  if (id == 0) return reader.evaluations.Original(submission);
  ASSIGN_OR_RETURN(EvaluationRow evaluation, reader.evaluations.Find(id));
  if (evaluation.submission != submission) {
    return absl::NotFoundError(absl::StrCat("submission ", submission, " has no evaluation ", id));
  }
  if (evaluation.kind != EvaluationKind::kRerun) return evaluation;
  return absl::FailedPreconditionError(
      absl::StrCat("evaluation ", id, " is a rerun, which has no receipt"));
}

// Until a rejudge is applied, only organisers know of its results.
absl::Status CheckRejudgeShown(const Transaction& reader, const EvaluationRow& evaluation,
                               bool everybody) {
  const int64_t rejudge = evaluation.rejudge;
  if (!CallerSees(reader, rejudge)) {
    return absl::NotFoundError(
        absl::StrCat("submission ", evaluation.submission, " has no evaluation ", evaluation.id));
  }
  if (rejudge == 0 || !everybody || reader.Board().WasApplied(rejudge)) return absl::OkStatus();
  return WithErrorCode(
      absl::FailedPreconditionError(absl::StrCat("evaluation ", evaluation.id, " is of rejudge ",
                                                 rejudge, ", which has not been applied")),
      kWithheldCode);
}

absl::StatusOr<Json> AskedReceipt(const Request& request, const Transaction& reader,
                                  const ApiContext& context) {
  RETURN_IF_ERROR(CheckParameters(request, {"evaluation", "public", "reason"}));
  RETURN_IF_ERROR(RequireSubmission(reader, ReadId(request)));
  ASSIGN_OR_RETURN(const bool everybody, ReadFlag(request, "public"));
  ASSIGN_OR_RETURN(const SubmissionRow submission, reader.submissions.Find(ReadId(request)));
  ASSIGN_OR_RETURN(const EvaluationRow evaluation, AskedEvaluation(request, reader, submission.id));
  RETURN_IF_ERROR(CheckRejudgeShown(reader, evaluation, everybody));
  RETURN_IF_ERROR(CheckReceiptShown(reader, context, submission, everybody));
  if (evaluation.state == EvaluationState::kFailed) {
    RETURN_IF_ERROR(CheckFailureShown(reader, context, submission));
  }
  return BuildReceipt(reader, context.record, submission, evaluation);
}

// What a copy of the record has in place of a receipt that AskedReceipt answered with `why`; the
// same status, if it is not withheld.
absl::StatusOr<WithheldReceipt> WithheldFor(const Request& request, const Transaction& reader,
                                            const ApiContext& context, const absl::Status& why) {
  const bool unreadable = ExtractDamage(why).has_value();
  if (!unreadable && ErrorCodeOf(why) != kWithheldCode) return why;
  WithheldReceipt withheld;
  RETURN_IF_ERROR(ReadNumber(request, "evaluation", INT64_MAX, withheld.evaluation));
  // Not of another submission's evaluation, which may be readable.
  const absl::StatusOr<EvaluationRow> evaluation = reader.evaluations.Find(withheld.evaluation);
  if (evaluation.ok() ? evaluation->submission != ReadId(request)
                      : !ExtractDamage(evaluation.status()).has_value()) {
    return why;
  }
  const int64_t rejudge = evaluation.ok() ? evaluation->rejudge : 0;
  withheld.reason = unreadable                                             ? "unreadable"
                    : rejudge != 0 && !reader.Board().WasApplied(rejudge) ? "rejudge"
                                                                           : "phase";
  ASSIGN_OR_RETURN(withheld.head, context.record.Head(reader));
  return withheld;
}

constexpr int64_t kMaxIndex = int64_t{1} << 40;
constexpr int64_t kMostEntries = 1000;

// The reader has checked that an entry is a JSON object. To parse and write each again would be
// most of an answer's time, and anybody may ask for a thousand.
std::string PageText(const Listed<RecordRow>& listed, int64_t size, const Json& next_from) {
  std::vector<std::string> entries;
  for (const RecordRow& row : listed.rows) {
    entries.push_back(absl::StrCat(R"({"chain":")", row.chain, R"(","entry":)", row.entry_json,
                                   R"(,"index":)", row.index, "}"));
  }
  return absl::StrCat(R"({"entries":[)", absl::StrJoin(entries, ","), R"(],"next_from":)",
                      next_from.dump(), R"(,"size":)", size, "}\n");
}

// Oldest first, as the record is read from its beginning and only grows at its end.
std::string NextPage(const Request& request, int64_t next) {
  std::string address = absl::StrCat(request.path, "?from=", next);
  if (request.HasParam("limit")) {
    absl::StrAppend(&address, "&limit=", request.Param("limit"));
  }
  return address;
}

ApiResult GetReceipt(const ApiContext& context, const Request& request) {
  ASSIGN_OR_RETURN(const bool reason, ReadFlag(request, "reason"));
  absl::StatusOr<Json> receipt = absl::InternalError("");
  std::optional<WithheldReceipt> withheld;
  RETURN_IF_ERROR(context.readers.Read([&](const Transaction& reader) -> absl::Status {
    receipt = AskedReceipt(request, reader, context);
    if (receipt.ok() || !reason) return receipt.status();
    ASSIGN_OR_RETURN(withheld, WithheldFor(request, reader, context, receipt.status()));
    return absl::OkStatus();
  }));
  ASSIGN_OR_RETURN(const std::shared_ptr<const SigningKey> key, context.receipts_key.Get());
  if (withheld.has_value()) {
    ASSIGN_OR_RETURN(Json json, SignWithheld(*withheld, *key));
    return ApiAnswer{200, std::move(json)};
  }
  ASSIGN_OR_RETURN(std::string text, SignReceipt(*receipt, *key));
  return ApiAnswer{200, Json::parse(text)};
}

ApiResult GetKey(const ApiContext& context, const Request&) {
  ASSIGN_OR_RETURN(const std::shared_ptr<const SigningKey> key, context.receipts_key.Get());
  return ApiAnswer{200, {{"algorithm", "ed25519"}, {"key", key->PublicPem()}}};
}

// A number that a request must have.
absl::StatusOr<int64_t> ReadIndex(const Request& request, const char* key, const char* what) {
  int64_t value = -1;
  RETURN_IF_ERROR(ReadNumber(request, key, kMaxIndex, value, /*min=*/0));
  if (value >= 0) return value;
  return absl::InvalidArgumentError(absl::StrCat("\"", key, "\" is missing: ", what));
}

ApiResult ListRecord(const ApiContext&, const Transaction& reader, const Request& request) {
  int64_t from = 0;
  int64_t limit = 100;
  RETURN_IF_ERROR(CheckParameters(request, {"from", "limit"}));
  RETURN_IF_ERROR(ReadNumber(request, "from", kMaxIndex, from, /*min=*/0));
  RETURN_IF_ERROR(ReadNumber(request, "limit", kMostEntries, limit));
  const int64_t size = reader.journal.RecordSize();
  const Listed<RecordRow> listed = reader.journal.Record(from, limit);
  const int64_t next = std::max(listed.last_id + 1, from + limit);
  const bool more = next < size;
  return ApiAnswer{.text = std::make_shared<const std::string>(
                       PageText(listed, size, more ? Json(next) : Json())),
                   .tagged = true,
                   .next = more ? NextPage(request, next) : ""};
}

ApiResult GetRecordHead(const ApiContext& context, const Transaction& reader,
                        const Request& request) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  ASSIGN_OR_RETURN(const RecordHead head, context.record.Head(reader));
  ASSIGN_OR_RETURN(const std::shared_ptr<const SigningKey> key, context.receipts_key.Get());
  ASSIGN_OR_RETURN(std::string text, SignHead(head, *key));
  return ApiAnswer{.text = std::make_shared<const std::string>(std::move(text)), .tagged = true};
}

ApiResult ProveEntry(const ApiContext& context, const Transaction& reader, const Request& request) {
  int64_t size = 0;
  RETURN_IF_ERROR(CheckParameters(request, {"entry", "size"}));
  RETURN_IF_ERROR(ReadNumber(request, "size", kMaxIndex, size));
  ASSIGN_OR_RETURN(const int64_t entry,
                   ReadIndex(request, "entry", "the index of the entry to prove"));
  ASSIGN_OR_RETURN(const EntryProof proof, context.record.Prove(reader, entry, size));
  return ApiAnswer{.body = EntryProofToJson(proof), .tagged = true};
}

ApiResult CompareRecords(const ApiContext& context, const Transaction& reader,
                         const Request& request) {
  int64_t to = 0;
  RETURN_IF_ERROR(CheckParameters(request, {"from", "to"}));
  RETURN_IF_ERROR(ReadNumber(request, "to", kMaxIndex, to, /*min=*/0));
  ASSIGN_OR_RETURN(const int64_t from,
                   ReadIndex(request, "from", "the size of the earlier record"));
  ASSIGN_OR_RETURN(const auto compared, context.record.Compare(reader, from, to));
  return ApiAnswer{.body = {{"from", from},
                            {"to", to == 0 ? reader.journal.RecordSize() : to},
                            {"from_root", ToHex(compared.from_root)},
                            {"to_root", ToHex(compared.to_root)},
                            {"proof", ProofToJson(compared.proof)}},
                   .tagged = true};
}

}  // namespace

void AddProof(Routes& routes, const ApiContext& context) {
  routes.Get(R"(/v1/submissions/(\d{1,18})/receipt)", Action::kReadReceipt,
             Bind(context, GetReceipt));
  routes.Get("/v1/key", Action::kReadKey, Bind(context, GetKey));
  routes.Get("/v1/record", Action::kReadRecord, Bind(context, ListRecord));
  routes.Get("/v1/record/head", Action::kReadRecord, Bind(context, GetRecordHead));
  routes.Get("/v1/record/proof", Action::kReadRecord, Bind(context, ProveEntry));
  routes.Get("/v1/record/consistency", Action::kReadRecord, Bind(context, CompareRecords));
}

}  // namespace myograde::server
