// Addresses, errors, and the requests that change something. What is only read:
// api_views.cc; uploads: api_uploads.cc.
#include "server/api/api.h"

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "server/api/requests.h"
#include "server/api/views.h"
#include "server/base/counted.h"
#include "server/base/peer_key.h"
#include "server/engine/stored.h"
#include "server/grading/results.h"
#include "server/proof/grader_build.h"

namespace myograde::server {
namespace {

constexpr char kJson[] = "application/json";

void Send(httplib::Response& response, int http, const nlohmann::json& body) {
  response.status = http;
  response.set_content(CanonicalJson(body) + "\n", kJson);
}

}  // namespace

ApiError ErrorOf(const absl::Status& status) {
  const std::string message(status.message());
  const std::string code = ErrorCodeOf(status);
  if (code == kDamagedRowCode) return {500, code, message};
  switch (status.code()) {
    case absl::StatusCode::kInvalidArgument:
      return {400, "bad_request", message};
    case absl::StatusCode::kNotFound:
      return {404, "not_found", message};
    case absl::StatusCode::kFailedPrecondition:
      return {409, code.empty() ? "conflict" : code, message};
    case absl::StatusCode::kCancelled:
      return {503, "stopping", message};
    case absl::StatusCode::kDeadlineExceeded:
      return {504, "deadline", message};
    case absl::StatusCode::kUnavailable:
      return {503, code.empty() ? "store" : code, message};
    case absl::StatusCode::kPermissionDenied:
    case absl::StatusCode::kResourceExhausted:
    case absl::StatusCode::kDataLoss:
      return {503, "store", message};
    default:
      return {500, "internal", message};
  }
}

std::string Api::Who() { return PeerKey(UnixHttpServer::PeerUid()); }

Api::Api(Options options, const Tracks& tracks, Engine& engine, ReaderPool& readers,
         KeyFile& receipts_key, const Clock& clock)
    : options_(std::move(options)),
      tracks_(tracks),
      engine_(engine),
      readers_(readers),
      receipts_key_(receipts_key),
      clock_(clock),
      began_(clock.Monotonic()) {}

void Api::SendError(httplib::Response& response, const ApiError& error) {
  if (error.http == 429 || error.http == 503) response.set_header("Retry-After", "1");
  if (error.http >= 500) spdlog::warn("answered {}: {}", error.http, error.message);
  Send(response, error.http, {{"error", {{"code", error.code}, {"message", error.message}}}});
}

void Api::SendAnswer(httplib::Response& response, const Answer& answer) {
  if (answer.text == nullptr) return Send(response, answer.http, answer.body);
  response.status = answer.http;
  response.set_content(*answer.text, kJson);
}

std::optional<ApiError> Api::OnlyOrganiser() const {
  if (UnixHttpServer::PeerIsOrganiser()) return std::nullopt;
  return ApiError{403, "forbidden", "only root and the user that runs the daemon may do this"};
}

ApiError Api::TeamErrorOf(const absl::Status& status, const std::string& team) const {
  ApiError error = ErrorOf(status);
  const std::string other = ResembledTeam(status);
  if (other.empty()) return error;
  spdlog::info("a team \"{}\" was refused: it looks like team \"{}\"", team, other);
  if (!OnlyOrganiser().has_value()) {
    error.message = absl::StrCat("the team's name looks like that of team \"", other,
                                 "\"; choose another name, or write that one exactly as it stands "
                                 "here");
  }
  return error;
}

void Api::Get(UnixHttpServer& server, const std::string& pattern,
              Result (Api::*handler)(const Request&)) {
  server.Get(pattern, [this, handler](const Request& request, httplib::Response& response) {
    const Result result = (this->*handler)(request);
    if (const auto* error = std::get_if<ApiError>(&result)) return SendError(response, *error);
    SendAnswer(response, std::get<Answer>(result));
  });
}

// The body is there as a whole, within its limits; cpp-httplib would take it for a form, if it is
// called one.
void Api::Post(UnixHttpServer& server, const std::string& pattern,
               Result (Api::*handler)(const Request&, const Json&)) {
  server.Post(pattern, [this, handler](const Request& request, httplib::Response& response,
                                       const httplib::ContentReader&) {
    const absl::StatusOr<std::string> body = UnixHttpServer::RequestBody().Text();
    if (!body.ok()) return SendError(response, ErrorOf(body.status()));
    const absl::StatusOr<Json> json = ParseJson(*body, "request");
    if (!json.ok()) return SendError(response, ErrorOf(json.status()));
    const Result result = (this->*handler)(request, *json);
    if (const auto* error = std::get_if<ApiError>(&result)) return SendError(response, *error);
    SendAnswer(response, std::get<Answer>(result));
  });
}

void Api::Install(UnixHttpServer& server) {
  Get(server, "/v1/health", &Api::Health);
  Get(server, "/v1/tracks", &Api::ListTracks);
  Get(server, "/v1/submissions", &Api::ListSubmissions);
  Get(server, R"(/v1/submissions/(\d{1,18}))", &Api::GetSubmission);
  Get(server, R"(/v1/submissions/(\d{1,18})/result)", &Api::GetResult);
  Get(server, R"(/v1/evaluations/(\d{1,18}))", &Api::GetEvaluation);
  Get(server, "/v1/leaderboard", &Api::GetLeaderboard);
  Get(server, "/v1/leaderboard/explain", &Api::Explain);
  Get(server, "/v1/quota", &Api::GetQuota);
  Post(server, "/v1/quota/grants", &Api::Grant);
  Post(server, "/v1/leaderboard/rebuild", &Api::RebuildBoards);
  Post(server, R"(/v1/submissions/(\d{1,18})/marks)", &Api::Mark);
  Get(server, R"(/v1/submissions/(\d{1,18})/receipt)", &Api::GetReceipt);
  Get(server, "/v1/key", &Api::GetKey);
  server.Get(R"(/v1/logs/([0-9a-f]{64}))",
             [this](const Request& request, httplib::Response& response) {
               SendLog(request, response);
             });
  Post(server, "/v1/submissions", &Api::Submit);
  Post(server, R"(/v1/submissions/(\d{1,18})/cancel)", &Api::Cancel);
  Post(server, R"(/v1/submissions/(\d{1,18})/rerun)", &Api::Rerun);
  server.Post("/v1/artefacts", [this](const Request& request, httplib::Response& response,
                                      const httplib::ContentReader&) {
    const Result result = Upload(request);
    if (const auto* error = std::get_if<ApiError>(&result)) return SendError(response, *error);
    SendAnswer(response, std::get<Answer>(result));
  });
  InstallTransfer(server);
  server.SetBodyRule("/v1/artefacts",
                     {.most = options_.config.artefacts.archive_bytes,
                      .upload = true,
                      .types = {"application/x-tar", "application/tar", "application/gzip",
                                "application/x-gzip", "application/zstd", "application/zip",
                                "application/octet-stream"}});
  server.SetBodyRule("/v1/import", {.most = options_.config.artefacts.archive_bytes,
                                    .upload = true,
                                    .organiser_only = true,
                                    .types = {"application/json", "application/octet-stream"}});
  server.set_error_handler([](const Request& request, httplib::Response& response) {
    if (!response.body.empty()) return;  // ours
    const char* code = response.status == 413 ? "too_large"
                       : response.status == 404 ? "not_found" : "bad_request";
    SendError(response, {response.status, code,
                         absl::StrCat("there is no ", request.method, " ", request.path,
                                      ", or the request is malformed; see the API's description")});
  });
  server.set_exception_handler([](const Request& request, httplib::Response& response,
                                  std::exception_ptr thrown) {
    std::string what = "unknown";
    try {
      std::rethrow_exception(thrown);
    } catch (const std::exception& error) {
      what = error.what();
    } catch (...) {
    }
    SendError(response, {500, "internal", absl::StrCat(request.method, " ", request.path,
                                                       " failed in the server: ", what)});
  });
}

absl::Status Api::HasFiles(const std::string& artefact) const {
  return HasArtefactFiles(options_.data_dir, artefact);
}

Api::Result Api::Submit(const Request&, const Json& body) {
  absl::StatusOr<SubmitRequest> request = ParseSubmit(body);
  if (!request.ok()) return ErrorOf(request.status());
  absl::StatusOr<TrackPtr> track = tracks_.Find(request->track, request->profile);
  if (!track.ok()) {
    const bool known = tracks_.entries().contains(request->track);
    return ApiError{400, known ? "unknown_profile" : "unknown_track",
                    std::string(track.status().message())};
  }
  const TrackConfig& config = (*track)->config;
  std::vector<uint64_t> seeds = request->seeds.value_or(config.seeds);
  const auto count = static_cast<int64_t>(seeds.size());
  if (request->episodes.value_or(1) > count) {
    return ApiError{400, "bad_request",
                    absl::StrCat("request: \"episodes\" is ", *request->episodes,
                                 ", the seed list has ", count)};
  }
  seeds.resize(static_cast<size_t>(request->episodes.value_or(count)));

  absl::StatusOr<ArtefactRow> artefact = absl::InternalError("");
  absl::Status status = readers_.Read([&](Reader& reader) {
    artefact = reader.Artefact(request->artefact);
    return artefact.status();
  });
  if (status.ok()) status = HasFiles(request->artefact);
  if (!status.ok()) return ErrorOf(status);
  if (artefact->bytes > config.budgets.submission_bytes ||
      artefact->files > config.budgets.submission_files) {
    return ApiError{400, "bad_artefact",
                    absl::StrCat("the artefact has ", artefact->bytes, " bytes in ",
                                 Counted(artefact->files, "file"), "; track \"", config.id,
                                 "\" allows ", config.budgets.submission_bytes, " bytes and ",
                                 config.budgets.submission_files, " files")};
  }
  for (const std::string& runtime : artefact->runtimes) {
    if (options_.config.runtimes.contains(runtime)) continue;
    return ApiError{400, "unknown_runtime",
                    absl::StrCat("this server has no runtime \"", runtime,
                                 "\", which the artefact's policy.json asks for")};
  }
  NewSubmission submission;
  submission.team = request->team;
  submission.artefact = request->artefact;
  submission.track = config.id;
  submission.profile = config.profile;
  submission.config = config.hash;
  submission.config_json = CanonicalJson(config.effective);
  submission.seeds_json = CanonicalJson(Json(seeds));
  submission.seeds = Sha256Hex(submission.seeds_json);
  submission.seed_count = static_cast<int64_t>(seeds.size());
  submission.ranked = seeds == config.seeds;
  submission.grader_json = CanonicalJson(GraderBuild(options_.cache_dir));
  submission.blocks = BlocksOf(submission.seed_count, config.episodes_per_lease);
  if (submission.ranked) {
    if (std::optional<ApiError> error = RefuseRanked(); error.has_value()) return *std::move(error);
  }
  absl::StatusOr<Accepted> accepted =
      engine_.Submit(submission, options_.config.quota.of(config.id), Who(),
                     options_.config.http.request);
  if (!accepted.ok()) return TeamErrorOf(accepted.status(), request->team);
  Answer answer{accepted->linked ? 200 : 201};
  status = readers_.Read([&](Reader& reader) -> absl::Status {
    absl::StatusOr<Json> view = Status(reader, accepted->submission);
    if (view.ok()) answer.body = *std::move(view);
    return view.status();
  });
  if (!status.ok()) return ErrorOf(status);
  answer.body["linked"] = accepted->linked;
  return answer;
}

Api::Result Api::Cancel(const Request& request, const Json& body) {
  absl::StatusOr<std::string> reason = ParseCancel(body);
  if (!reason.ok()) return ErrorOf(reason.status());
  const int64_t id = std::stoll(request.matches[1]);
  const auto exists = [&](Reader& reader) { return reader.Submission(id).status(); };
  absl::Status status = readers_.Read(exists);
  if (!status.ok()) return ErrorOf(status);
  const absl::StatusOr<CancelReport> report =
      engine_.Cancel(id, *reason, Who(), options_.config.http.request);
  if (!report.ok()) return ErrorOf(report.status());
  Result result = GetSubmission(request);
  if (Answer* answer = std::get_if<Answer>(&result)) {
    std::string charged;
    status = readers_.Read([&](Reader& reader) {
      charged = reader.ChargedBudget(id);
      return absl::OkStatus();
    });
    if (!status.ok()) return ErrorOf(status);
    answer->body["cancel"] = {{"killed", report->killed},
                              {"still_ending", report->still_ending},
                              {"took_wall_s", absl::ToDoubleSeconds(report->took)},
                              {"charged", TextOrNull(charged)}};
  }
  return result;
}

Api::Result Api::Rerun(const Request& request, const Json& body) {
  absl::StatusOr<RerunRequest> wanted = ParseRerun(body);
  if (!wanted.ok()) return ErrorOf(wanted.status());
  const int64_t id = std::stoll(request.matches[1]);
  NewRerun rerun{id, "", CanonicalJson(GraderBuild(options_.cache_dir)), {}};
  absl::Status status = readers_.Read([&](Reader& reader) -> absl::Status {
    if (absl::Status known = reader.Submission(id).status(); !known.ok()) return known;
    const absl::StatusOr<EvaluationRow> evaluation = reader.Original(id);
    if (!evaluation.ok()) return evaluation.status();
    // What can't be played must not be there afterwards.
    StoredContent content;
    const absl::StatusOr<StoredEvaluation> stored =
        LoadEvaluation(reader, evaluation->id, content);
    if (!stored.ok()) return stored.status();
    const EvaluationRow& original = stored->evaluation;
    if (!IsFinal(original.state)) {
      return absl::FailedPreconditionError(absl::StrCat(
          "submission ", id, " has not ended; wait for it, or cancel it, before it is run again"));
    }
    if (wanted->last.value_or(0) > original.last) {
      return absl::InvalidArgumentError(
          absl::StrCat("request: \"last\" is ", *wanted->last, ", the last episode of submission ",
                       id, " is ", original.last));
    }
    rerun.artefact = stored->submission.artefact;
    if (absl::Status files = HasFiles(rerun.artefact); !files.ok()) return files;
    for (const LeaseRow& lease : stored->leases) {
      const bool wants = lease.last >= wanted->first.value_or(0) &&
                         lease.first <= wanted->last.value_or(original.last);
      if (wants) rerun.blocks.emplace_back(lease.first, lease.last);
    }
    return absl::OkStatus();
  });
  if (!status.ok()) return ErrorOf(status);
  absl::StatusOr<Accepted> accepted = engine_.Rerun(
      rerun, Who(), UnixHttpServer::PeerIsOrganiser(), options_.config.reruns,
      options_.config.http.request);
  if (!accepted.ok()) return ErrorOf(accepted.status());
  return Answer{201,
                {{"evaluation", accepted->evaluation},
                 {"submission", id},
                 {"kind", "rerun"},
                 {"state", "queued"},
                 {"first", rerun.blocks.front().first},
                 {"last", rerun.blocks.back().second}}};
}

}  // namespace myograde::server
