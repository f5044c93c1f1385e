#include "server/api/resources.h"

#include <algorithm>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/api/log_access.h"
#include "server/api/phase_sight.h"
#include "server/api/receipt_view.h"
#include "server/api/record_log.h"
#include "server/api/requests.h"
#include "server/api/views.h"
#include "server/proof/receipt.h"
#include "server/proof/record_head.h"
#include "server/runner/log_keeper.h"
#include "server/store/damage.h"
#include "server/store/quota.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// A receipt lists the result of each episode, so a phase that withholds those withholds it as a whole.
// `everybody`: whoever the caller is, it is to be published.
absl::Status CheckReceiptShown(Reader& reader, const ApiContext& context,
                               const SubmissionRow& submission, bool everybody) {
  absl::StatusOr<bool> shown = true;
  if (everybody) {
    shown = IsPhasePublic(reader, context, submission.phase);
  } else {
    const absl::StatusOr<Visibility> sight = SightOfPhase(reader, context, submission.phase);
    shown = sight.ok() ? absl::StatusOr<bool>(SeesReceipt(*sight)) : sight.status();
  }
  if (!shown.ok()) return shown.status();
  if (*shown) return absl::OkStatus();
  return WithheldError(absl::StrCat("the receipt of submission ", submission.id, " lists the "
                                    "result of each episode, which phase \"", submission.phase,
                                    "\" withholds"));
}

// Of a failed submission, a phase that withholds anything shows no single episode (redaction.h).
absl::Status CheckFailureShown(Reader& reader, const ApiContext& context,
                               const SubmissionRow& submission) {
  const absl::StatusOr<Visibility> sight = SightOfPhase(reader, context, submission.phase);
  if (!sight.ok() || sight->progress) return sight.status();
  return WithheldError(absl::StrCat("submission ", submission.id, " failed, and its receipt lists how "
                                    "each episode ended, which phase \"", submission.phase,
                                    "\" withholds"));
}

// The evaluation that the request asks for; without one, the submission's original.
absl::StatusOr<EvaluationRow> AskedEvaluation(const Request& request, Reader& reader,
                                              int64_t submission) {
  int64_t id = 0;
  RETURN_IF_ERROR(ReadNumber(request, "evaluation", INT64_MAX, id));
  if (id == 0) return reader.Original(submission);
  absl::StatusOr<EvaluationRow> evaluation = reader.Evaluation(id);
  if (!evaluation.ok()) return evaluation;
  if (evaluation->submission != submission) {
    return absl::NotFoundError(
        absl::StrCat("submission ", submission, " has no evaluation ", id));
  }
  if (evaluation->kind != EvaluationKind::kRerun) return evaluation;
  return absl::FailedPreconditionError(absl::StrCat(
      "evaluation ", id, " is a re-run, which is for comparison and has no receipt"));
}

// Until a rejudge is applied, only organisers know of its results.
absl::Status CheckRejudgeShown(Reader& reader, const EvaluationRow& evaluation, bool everybody) {
  const RejudgeSight rejudge = reader.RejudgeOfEvaluation(evaluation.id);
  if (rejudge.rejudge == 0) return absl::OkStatus();
  if (!CallerSees(rejudge)) {
    return absl::NotFoundError(absl::StrCat("submission ", evaluation.submission,
                                            " has no evaluation ", evaluation.id));
  }
  if (!everybody || rejudge.ever_applied) return absl::OkStatus();
  return WithErrorCode(absl::FailedPreconditionError(absl::StrCat(
                           "evaluation ", evaluation.id, " is of rejudge ", rejudge.rejudge,
                           ", which has not been applied")),
                       kWithheldCode);
}

absl::StatusOr<nlohmann::json> AskedReceipt(const Request& request, Reader& reader,
                                            const ApiContext& context) {
  absl::Status status = CheckParameters(request, {"evaluation", "public", "reason"});
  if (status.ok()) status = RequireSubmission(reader, IdOf(request));
  if (!status.ok()) return status;
  ASSIGN_OR_RETURN(const bool everybody, ReadFlag(request, "public"));
  ASSIGN_OR_RETURN(const SubmissionRow submission, reader.Submission(IdOf(request)));
  ASSIGN_OR_RETURN(const EvaluationRow evaluation, AskedEvaluation(request, reader, submission.id));
  status = CheckRejudgeShown(reader, evaluation, everybody);
  if (status.ok()) status = CheckReceiptShown(reader, context, submission, everybody);
  if (status.ok() && evaluation.state == EvaluationState::kFailed) {
    status = CheckFailureShown(reader, context, submission);
  }
  if (!status.ok()) return status;
  return ReceiptOf(reader, context.record, submission, evaluation);
}

// What a copy of the record has in place of a receipt that AskedReceipt answered with `why`; the same
// status, if it is not withheld.
absl::StatusOr<WithheldReceipt> WithheldFor(const Request& request, Reader& reader,
                                            const ApiContext& context, const absl::Status& why) {
  const bool unreadable = DamageOf(why).has_value();
  if (!unreadable && ErrorCodeOf(why) != kWithheldCode) return why;
  WithheldReceipt withheld;
  absl::Status status = ReadNumber(request, "evaluation", INT64_MAX, withheld.evaluation);
  if (!status.ok()) return status;
  // Not of another submission's evaluation, which may be readable.
  const absl::StatusOr<EvaluationRow> evaluation = reader.Evaluation(withheld.evaluation);
  if (evaluation.ok() ? evaluation->submission != IdOf(request)
                      : !DamageOf(evaluation.status()).has_value()) {
    return why;
  }
  const RejudgeSight rejudge = reader.RejudgeOfEvaluation(withheld.evaluation);
  withheld.reason = unreadable                                     ? "unreadable"
                    : rejudge.rejudge != 0 && !rejudge.ever_applied ? "rejudge"
                                                                    : "phase";
  ASSIGN_OR_RETURN(withheld.head, context.record.Head(reader));
  return withheld;
}

constexpr int64_t kMaxIndex = int64_t{1} << 40;
constexpr int64_t kMostEntries = 1000;

// The reader has checked that an entry is a JSON object. To parse and write each again would be most of
// an answer's time, and anybody may ask for a thousand.
std::string PageText(const Listed<RecordRow>& listed, int64_t size, const Json& next_from) {
  std::vector<std::string> entries;
  for (const RecordRow& row : listed.rows) {
    entries.push_back(absl::StrCat(R"({"chain":")", row.chain, R"(","entry":)", row.entry_json,
                                   R"(,"index":)", row.index, "}"));
  }
  return absl::StrCat(R"({"entries":[)", absl::StrJoin(entries, ","), R"(],"next_from":)", next_from.dump(),
                      R"(,"size":)", size, R"(,"unreadable":)",
                      CanonicalJson(DamagedToJson(listed.damaged)), "}\n");
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
  absl::StatusOr<nlohmann::json> receipt = absl::InternalError("");
  std::optional<WithheldReceipt> withheld;
  const absl::Status status = context.readers.Read([&](Reader& reader) {
    receipt = AskedReceipt(request, reader, context);
    // A copy's boards can't be compared with those of a store that can't read what they follow from.
    if (reason && (receipt.ok() || ErrorCodeOf(receipt.status()) == kWithheldCode)) {
      const absl::Status rows = reader.CheckStandingRows(IdOf(request));
      if (DamageOf(rows).has_value()) receipt = rows;
    }
    if (receipt.ok() || !reason) return receipt.status();
    absl::StatusOr<WithheldReceipt> why = WithheldFor(request, reader, context, receipt.status());
    if (why.ok()) withheld = *std::move(why);
    return why.status();
  });
  RETURN_IF_ERROR(status);
  ASSIGN_OR_RETURN(const std::shared_ptr<const SigningKey> key, context.receipts_key.Get());
  if (withheld.has_value()) {
    ASSIGN_OR_RETURN(nlohmann::json json, SignWithheld(*withheld, *key));
    return ApiAnswer{200, std::move(json)};
  }
  ASSIGN_OR_RETURN(std::string text, SignReceipt(*receipt, *key));
  return ApiAnswer{200, nlohmann::json::parse(text)};
}

ApiResult GetKey(const ApiContext& context, const Request&) {
  ASSIGN_OR_RETURN(const std::shared_ptr<const SigningKey> key, context.receipts_key.Get());
  return ApiAnswer{200, {{"algorithm", "ed25519"}, {"key", key->PublicPem()}}};
}

// The file as it is stored. Its name is a hash, so no path of a client's making is opened.
absl::Status SendLog(const ApiContext& context, const Request& request, Response& response) {
  const std::string hash = request.matches[1];
  absl::Status sent = RequireShownLog(context, hash);
  if (sent.ok()) {
    const std::string path = absl::StrCat(context.data_dir, "/logs/", LogFileName(hash));
    sent = response.SetFile(path, "application/zstd");
  }
  if (sent.ok()) return absl::OkStatus();
  return absl::IsNotFound(sent) ? MissingLog(hash) : sent;
}

ApiResult ListRecord(const ApiContext& context, const Request& request) {
  int64_t from = 0;
  int64_t limit = 100;
  absl::Status status = CheckParameters(request, {"from", "limit"});
  status.Update(ReadNumber(request, "from", kMaxIndex, from, /*min=*/0));
  status.Update(ReadNumber(request, "limit", kMostEntries, limit));
  RETURN_IF_ERROR(status);
  ApiAnswer answer{.tagged = true};
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) -> absl::Status {
    const int64_t size = reader.RecordSize();
    const Listed<RecordRow> listed = reader.Record(from, limit);
    const int64_t next = std::max(listed.last_id + 1, from + limit);
    if (next < size) answer.next = NextPage(request, next);
    answer.text = std::make_shared<const std::string>(
        PageText(listed, size, next < size ? Json(next) : Json()));
    return absl::OkStatus();
  }));
  return answer;
}

ApiResult GetRecordHead(const ApiContext& context, const Request& request) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  ASSIGN_OR_RETURN(RecordHead head, context.readers.Read<RecordHead>([&](Reader& reader) {
    return context.record.Head(reader);
  }));
  ASSIGN_OR_RETURN(const std::shared_ptr<const SigningKey> key, context.receipts_key.Get());
  ASSIGN_OR_RETURN(std::string text, SignHead(head, *key));
  ApiAnswer answer{.tagged = true};
  answer.text = std::make_shared<const std::string>(std::move(text));
  return answer;
}

ApiResult ProveEntry(const ApiContext& context, const Request& request) {
  int64_t entry = -1;
  int64_t size = 0;
  absl::Status status = CheckParameters(request, {"entry", "size"});
  status.Update(ReadNumber(request, "entry", kMaxIndex, entry, /*min=*/0));
  status.Update(ReadNumber(request, "size", kMaxIndex, size));
  if (status.ok() && entry < 0) {
    status = absl::InvalidArgumentError("\"entry\" is missing: the index of the entry to prove");
  }
  RETURN_IF_ERROR(status);
  ApiAnswer answer{.tagged = true};
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) {
    const absl::StatusOr<EntryProof> proof = context.record.Prove(reader, entry, size);
    if (proof.ok()) answer.body = EntryProofToJson(*proof);
    return proof.status();
  }));
  return answer;
}

ApiResult CompareRecords(const ApiContext& context, const Request& request) {
  int64_t from = -1;
  int64_t to = 0;
  absl::Status status = CheckParameters(request, {"from", "to"});
  status.Update(ReadNumber(request, "from", kMaxIndex, from, /*min=*/0));
  status.Update(ReadNumber(request, "to", kMaxIndex, to, /*min=*/0));
  if (status.ok() && from < 0) {
    status = absl::InvalidArgumentError("\"from\" is missing: the size of the earlier record");
  }
  RETURN_IF_ERROR(status);
  ApiAnswer answer{.tagged = true};
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) {
    ASSIGN_OR_RETURN(const auto compared, context.record.Compare(reader, from, to));
    answer.body = {{"from", from},
                   {"to", to == 0 ? reader.RecordSize() : to},
                   {"from_root", HexOf(compared.from_root)},
                   {"to_root", HexOf(compared.to_root)},
                   {"proof", ProofToJson(compared.proof)}};
    return absl::OkStatus();
  }));
  return answer;
}

}  // namespace

void AddProof(Routes& routes, const ApiContext& context) {
  routes.Get(R"(/v1/submissions/(\d{1,18})/receipt)", Action::kReadReceipt,
             std::bind_front(GetReceipt, std::cref(context)));
  routes.Get("/v1/key", Action::kReadKey, std::bind_front(GetKey, std::cref(context)));
  routes.GetFile(R"(/v1/logs/([0-9a-f]{64}))", Action::kReadLog,
                 std::bind_front(SendLog, std::cref(context)));
  routes.Get("/v1/record", Action::kReadRecord, std::bind_front(ListRecord, std::cref(context)));
  routes.Get("/v1/record/head", Action::kReadRecord, std::bind_front(GetRecordHead, std::cref(context)));
  routes.Get("/v1/record/proof", Action::kReadRecord, std::bind_front(ProveEntry, std::cref(context)));
  routes.Get("/v1/record/consistency", Action::kReadRecord,
             std::bind_front(CompareRecords, std::cref(context)));
}

}  // namespace myograde::server
