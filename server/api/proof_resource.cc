#include "server/api/proof_resource.h"

#include <functional>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/lease/policy_seed.h"
#include "server/api/requests.h"
#include "server/engine/stored.h"
#include "server/grading/results.h"
#include "server/proof/receipt.h"
#include "server/runner/log_keeper.h"

namespace myograde::server {
namespace {

// Everything that the result is a function of, and the result.
absl::StatusOr<nlohmann::json> ReceiptOf(Reader& reader, int64_t id) {
  absl::StatusOr<SubmissionRow> submission = reader.Submission(id);
  if (!submission.ok()) return submission.status();
  const absl::StatusOr<EvaluationRow> original = reader.Original(id);
  if (!original.ok()) return original.status();
  const EvaluationRow& evaluation = *original;
  if (evaluation.state != EvaluationState::kDone && evaluation.state != EvaluationState::kFailed) {
    return absl::FailedPreconditionError(
        absl::StrCat("submission ", id, " is ", std::string(EvaluationStateName(evaluation.state)),
                     "; there is a receipt once it is done or failed"));
  }
  absl::StatusOr<std::string> config = reader.ConfigJson(submission->config);
  if (!config.ok()) return config.status();
  const absl::StatusOr<TrackConfig> track = StoredConfig(reader, submission->config);
  if (!track.ok()) return track.status();
  const absl::StatusOr<std::vector<EpisodeRow>> read = reader.Episodes(evaluation.id);
  if (!read.ok()) return read.status();
  const std::vector<EpisodeRow>& rows = *read;
  const scoring::ScoredTrack& scored = *scoring::FindScoredTrack(track->kind->name);
  absl::StatusOr<scoring::Aggregate> aggregate = AggregateRows(scored, rows);
  if (!aggregate.ok()) return aggregate.status();
  nlohmann::json episodes = nlohmann::json::array();
  nlohmann::json policy_seeds;  // null: they follow from the store's secret
  for (const EpisodeRow& row : rows) {
    episodes.push_back(ReceiptEntry(row));
    if (!track->policy_seed_secret.has_value()) continue;
    policy_seeds.push_back(PolicySeed(*track->policy_seed_secret, row.index));
  }
  return nlohmann::json{
      {"format", 1},
      {"submission", id},
      {"evaluation", evaluation.id},
      {"team", submission->team},
      {"name", submission->artefact_name},
      {"track", submission->track},
      {"track_kind", track->kind->name},
      {"profile", submission->profile},
      {"ranked", submission->ranked},
      {"state", EvaluationStateName(evaluation.state)},
      {"artefact", submission->artefact},
      {"config", submission->config},
      {"track_config", nlohmann::json::parse(*config)},
      {"seeds", submission->seeds},
      {"policy_seeds", std::move(policy_seeds)},
      {"grader", nlohmann::json::parse(evaluation.grader_json, nullptr, false)},
      {"aggregate", AggregateToJson(scored, *aggregate)},
      {"results", ResultsHash(rows)},
      {"merkle_root", MerkleRootOf(rows)},
      {"episodes", std::move(episodes)}};
}

// Two teams have the same log if they handed in the same policy.
absl::Status RequireLog(Reader& reader, const std::string& hash, const absl::Status& missing) {
  const std::set<std::string> teams = reader.TeamsOfLog(hash);
  if (teams.empty()) return missing;
  for (const std::string& team : teams) {
    if (Caller().teams.contains(team)) return Require(team, missing);
  }
  return Require(*teams.begin(), missing);
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
  absl::Status sent = CallerIsOrganiser() ? absl::OkStatus()
                                          : context_.readers.Read([&](Reader& reader) {
                                              return RequireLog(reader, hash, missing);
                                            });
  if (sent.ok()) {
    const std::string path = absl::StrCat(context_.data_dir, "/logs/", LogFileName(hash));
    sent = UnixHttpServer::AnswerWithFile(path, "application/zstd", response);
  }
  if (sent.ok()) return std::nullopt;
  return ErrorOf(absl::IsNotFound(sent) ? missing : sent);
}

}  // namespace myograde::server
