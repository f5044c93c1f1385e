#include "server/api/proof_resource.h"

#include <functional>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "server/api/phase_sight.h"
#include "server/api/receipt_view.h"
#include "server/api/requests.h"
#include "server/proof/receipt.h"
#include "server/runner/log_keeper.h"

namespace myograde::server {
namespace {

// Two teams have the same log if they handed in the same policy.
absl::Status RequireLog(Reader& reader, const std::string& hash, const absl::Status& missing) {
  const std::set<std::string> teams = reader.TeamsOfLog(hash);
  if (teams.empty()) return missing;
  for (const std::string& team : teams) {
    if (Caller().teams.contains(team)) return Require(team, missing);
  }
  return Require(*teams.begin(), missing);
}

// A receipt lists the result of each episode, so a phase that withholds those withholds it as a whole.
absl::Status CheckReceiptShown(Reader& reader, const ApiContext& context, int64_t submission) {
  const absl::StatusOr<SubmissionRow> row = reader.Submission(submission);
  if (!row.ok()) return row.status();
  const absl::StatusOr<Visibility> sight = SightOfPhase(reader, context, row->phase);
  if (!sight.ok() || SeesReceipt(*sight)) return sight.status();
  return WithheldError(absl::StrCat("the receipt of submission ", submission, " lists the result of "
                                    "each episode, which phase \"", row->phase, "\" withholds"));
}

// A log holds its episode's seed. Equal logs are of one phase, as they hold their config.
absl::Status CheckLogShown(Reader& reader, const ApiContext& context, const std::string& hash) {
  for (const std::string& phase : reader.PhasesOfLog(hash)) {
    const absl::StatusOr<Visibility> sight = SightOfPhase(reader, context, phase);
    if (!sight.ok()) return sight.status();
    if (SeesLogs(*sight)) continue;
    return WithheldError(absl::StrCat("phase \"", phase, "\" withholds the logs of its episodes"));
  }
  return absl::OkStatus();
}

}  // namespace

void ProofResource::Install(Routes& routes) {
  routes.Get(R"(/v1/submissions/(\d{1,18})/receipt)", Action::kReadReceipt,
             std::bind_front(&ProofResource::GetReceipt, this));
  routes.Get("/v1/key", Action::kReadKey, std::bind_front(&ProofResource::GetKey, this));
  routes.GetFile(R"(/v1/logs/([0-9a-f]{64}))", Action::kReadLog,
                 std::bind_front(&ProofResource::SendLog, this));
}

ApiResult ProofResource::GetReceipt(const httplib::Request& request) const {
  absl::StatusOr<nlohmann::json> receipt = absl::InternalError("");
  const absl::Status status = context_.readers.Read([&](Reader& reader) -> absl::Status {
    const absl::Status own = RequireSubmission(reader, IdOf(request));
    if (!own.ok()) return own;
    if (absl::Status shown = CheckReceiptShown(reader, context_, IdOf(request)); !shown.ok()) {
      return shown;
    }
    receipt = ReceiptOf(reader, IdOf(request));
    return receipt.status();
  });
  if (!status.ok()) return ErrorOf(status);
  const absl::StatusOr<std::shared_ptr<const SigningKey>> key = context_.receipts_key.Get();
  if (!key.ok()) return ErrorOf(key.status());
  absl::StatusOr<std::string> text = SignReceipt(*receipt, **key);
  if (!text.ok()) return ErrorOf(text.status());
  return ApiAnswer{200, nlohmann::json::parse(*text)};
}

ApiResult ProofResource::GetKey(const httplib::Request&) const {
  const absl::StatusOr<std::shared_ptr<const SigningKey>> key = context_.receipts_key.Get();
  if (!key.ok()) return ErrorOf(key.status());
  return ApiAnswer{200, {{"algorithm", "ed25519"}, {"key", (*key)->PublicPem()}}};
}

// The file as it is stored. Its name is a hash, so no path of a client's making is opened.
std::optional<ApiError> ProofResource::SendLog(const httplib::Request& request,
                                               httplib::Response& response) const {
  const std::string hash = request.matches[1];
  const absl::Status missing = absl::NotFoundError(
      absl::StrCat("there is no log ", hash, " here; it was never kept, or was removed"));
  absl::Status sent;
  if (!CallerIsOrganiser()) {
    sent = context_.readers.Read([&](Reader& reader) {
      const absl::Status own = RequireLog(reader, hash, missing);
      return own.ok() ? CheckLogShown(reader, context_, hash) : own;
    });
  }
  if (sent.ok()) {
    const std::string path = absl::StrCat(context_.data_dir, "/logs/", LogFileName(hash));
    sent = UnixHttpServer::AnswerWithFile(path, "application/zstd", response);
  }
  if (sent.ok()) return std::nullopt;
  return ErrorOf(absl::IsNotFound(sent) ? missing : sent);
}

}  // namespace myograde::server
