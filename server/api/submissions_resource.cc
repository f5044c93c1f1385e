#include "server/api/resources.h"

#include <cstdint>
#include <functional>
#include <iterator>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/status_macros.h"
#include "server/api/founding.h"
#include "server/api/paging.h"
#include "server/api/phase_sight.h"
#include "server/api/redaction.h"
#include "server/api/requests.h"
#include "server/api/submission_view.h"
#include "server/api/http_server.h"
#include "server/api/views.h"
#include "server/store/damage.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

class UploadedBody : public IncomingArchive {
 public:
  explicit UploadedBody(Body& body) : body_(body) {}
  int64_t size() const override { return body_.size(); }
  ssize_t ReadAt(char* to, size_t size, int64_t offset) const override {
    return body_.ReadAt(to, size, offset);
  }
  absl::Status MoveTo(const std::string& path) override { return body_.MoveTo(path); }

 private:
  Body& body_;
};

absl::StatusOr<UploadRequest> ParseUpload(const Request& request) {
  absl::Status status = CheckParameters(request, {"team", "track"});
  if (status.ok() && request.HasParam("team") != request.HasParam("track")) {
    status = absl::InvalidArgumentError("\"team\" and \"track\" go together: give both or none");
  }
  const std::string team = request.Param("team");
  if (status.ok() && request.HasParam("team")) status = CheckTeam(team);
  if (!status.ok()) return status;
  return UploadRequest{.from = {CallerKey(), team, CallerIsOrganiser()},
                       .track = request.Param("track"),
                       .stopping = HttpServer::Stopping};
}

// For an upload without a team: one of the caller's must still be allowed to hand something in.
absl::Status CheckSomeTeam(ReaderPool& readers) {
  if (CallerIsOrganiser() || Caller().teams.empty()) return absl::OkStatus();
  return readers.Read([](Reader& reader) {
    absl::Status refusal;
    for (const std::string& team : Caller().teams) {
      refusal = reader.CheckTeam(team);
      if (refusal.ok()) break;
    }
    return refusal;
  });
}

ApiResult UploadArtefact(const ApiContext& context, const Request& request) {
  ASSIGN_OR_RETURN(UploadRequest upload, ParseUpload(request));
  if (upload.from.team.empty()) {
    RETURN_IF_ERROR(CheckSomeTeam(context.readers));
  } else {
    ASSIGN_OR_RETURN(std::optional<Founding> founding, FoundingFor(context, upload.from.team));
    // An organiser may upload for a team of others.
    if (!CallerIsOrganiser()) upload.founding = std::move(founding);
  }
  UploadedBody body(*request.body);
  const absl::StatusOr<ReceivedArtefact> received = context.admission.Receive(upload, body);
  if (!received.ok()) return TeamErrorOf(received.status(), upload.from.team);
  const ArtefactRow& artefact = received->artefact;
  return ApiAnswer{received->is_new ? 201 : 200,
                   {{"artefact", artefact.hash},
                    {"name", artefact.name},
                    {"command", artefact.command},
                    {"runtimes", artefact.runtimes},
                    {"env", artefact.environment},
                    {"adapter", artefact.adapter.empty() ? nlohmann::json() : nlohmann::json(artefact.adapter)},
                    {"extra_observations", artefact.extra_observations},
                    {"image", artefact.image ? PolicyImageToJson(*artefact.image) : nlohmann::json()},
                    {"bytes", artefact.bytes},
                    {"files", artefact.files},
                    {"new", received->is_new}}};
}

ApiResult ListSubmissions(const ApiContext& context, const Request& request) {
  ASSIGN_OR_RETURN(SubmissionFilter filter, ParseFilter(request));
  if (!CallerIsOrganiser()) filter.teams = Caller().teams;
  Json list = Json::array();
  Listed<SubmissionRow> found;
  bool more = false;
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) {
    filter.team = reader.TeamOf(filter.team);
    found = reader.Submissions(filter);
    more = std::ssize(found.rows) + std::ssize(found.damaged) == filter.limit;
    for (const SubmissionRow& row : found.rows) {
      const absl::StatusOr<EvaluationRow> original = reader.Original(row.id);
      if (original.ok()) {
        ASSIGN_OR_RETURN(const Visibility sight, SightOfPhase(reader, context, row.phase));
        list.push_back(SubmissionToJson(
            row, *original, reader.Counts(original->id, !sight.progress)));
        RedactListed(list.back(), sight);
      } else if (const std::optional<Damage> damage = DamageOf(original.status())) {
        found.damaged.push_back(*damage);
      } else {
        return original.status();
      }
    }
    return absl::OkStatus();
  }));
  ApiAnswer answer{200,
                   {{"submissions", std::move(list)},
                    {"unreadable", DamagedToJson(found.damaged)}}};
  AddNextPage(request, more, found.last_id, answer);
  return answer;
}

ApiResult StatusAnswer(const ApiContext& context, int64_t submission) {
  ApiAnswer answer;
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(answer.body, SubmissionStatus(reader, context, submission));
    return absl::OkStatus();
  }));
  return answer;
}

ApiResult GetSubmission(const ApiContext& context, const Request& request) {
  const absl::Status own = context.readers.Read(
      [&](Reader& reader) { return RequireSubmission(reader, IdOf(request)); });
  RETURN_IF_ERROR(own);
  return StatusAnswer(context, IdOf(request));
}

ApiResult CreateSubmission(const ApiContext& context, const Request& request, const Json& body) {
  ASSIGN_OR_RETURN(SubmitRequest asked, ParseSubmit(body));
  ASSIGN_OR_RETURN(RequestKey key, ReadRequestKey(request, body));
  asked.key = std::move(key);
  ASSIGN_OR_RETURN(std::optional<Founding> founding, FoundingFor(context, asked.team));
  asked.founding = std::move(founding);
  asked.organiser = CallerIsOrganiser();
  const absl::StatusOr<Accepted> accepted = context.admission.Submit(asked, CallerKey());
  if (!accepted.ok()) return TeamErrorOf(accepted.status(), asked.team);
  NoteAct(absl::StrCat("submission ", accepted->submission),
          absl::StrCat("for team ", asked.team, accepted->is_new() ? "" : ", known already"));
  ASSIGN_OR_RETURN(ApiAnswer answer, StatusAnswer(context, accepted->submission));
  answer.http = accepted->is_new() ? 201 : 200;
  answer.body["linked"] = accepted->linked;
  answer.body["repeated"] = accepted->repeated;
  return answer;
}

ApiResult CancelSubmission(const ApiContext& context, const Request& request, const Json& body) {
  ASSIGN_OR_RETURN(const std::string reason, ParseCancel(body));
  const int64_t id = IdOf(request);
  absl::StatusOr<Visibility> sight = Visibility{};
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) {
    RETURN_IF_ERROR(RequireSubmission(reader, id));
    ASSIGN_OR_RETURN(const SubmissionRow row, reader.Submission(id));
    // Practice is of no phase, and organisers see all: neither is charged for a cancel as such.
    sight = SightOfPhase(reader, context, row.phase);
    return sight.status();
  }));
  ASSIGN_OR_RETURN(const CancelReport report, context.engine.Cancel({.submission = id,
                                                                     .reruns = CallerIsOrganiser(),
                                                                     .charge = !sight->progress,
                                                                     .why = reason,
                                                                     .who = CallerKey()},
                                                                    context.config.http.request));
  NoteAct(absl::StrCat("submission ", id), reason);
  ASSIGN_OR_RETURN(ApiAnswer answer, StatusAnswer(context, id));
  std::string charged;
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) {
    charged = reader.ChargedBudget(id);
    return absl::OkStatus();
  }));
  answer.body["cancel"] = {{"killed", report.killed},
                            {"still_ending", report.still_ending},
                            {"took_wall_s", absl::ToDoubleSeconds(report.took)},
                            {"charged", TextOrNull(charged)}};
  return answer;
}

ApiResult MarkSubmission(const ApiContext& context, const Request& request, const Json& body) {
  ASSIGN_OR_RETURN(MarkRequest wanted, ParseMark(body));
  const int64_t id = IdOf(request);
  // What can't be answered is not done.
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) {
    absl::Status readable = reader.Submission(id).status();
    readable.Update(reader.MarkHistory(id).status());
    return readable;
  }));
  const absl::StatusOr<bool> changed = context.engine.Change<bool>(
      [id, who = CallerKey(), mark = wanted](Writer& writer) {
        return writer.Mark(id, mark.mark, mark.set, who, mark.reason);
      },
      context.config.http.request);
  absl::Status status = changed.status();
  ApiAnswer answer;
  if (status.ok()) {
    status = context.readers.Read([&](Reader& reader) -> absl::Status {
      ASSIGN_OR_RETURN(SubmissionRow submission, reader.Submission(id));
      ASSIGN_OR_RETURN(const std::vector<MarkRow> marks, reader.MarkHistory(id));
      answer.body = {{"submission", id},
                     {"team", submission.team},
                     {"track", submission.track},
                     {"profile", submission.profile},
                     {"mark", wanted.mark},
                     {"set", wanted.set},
                     {"changed", *changed},
                     {"marks", MarksToJson(marks)}};
      return absl::OkStatus();
    });
  }
  RETURN_IF_ERROR(status);
  NoteAct(absl::StrCat("submission ", id),
          absl::StrCat(wanted.set ? "" : "not ", wanted.mark,
                       wanted.reason.empty() ? "" : ": ", wanted.reason));
  return answer;
}

}  // namespace

void AddSubmissions(Routes& routes, const ApiContext& context) {
  routes.Get("/v1/submissions", Action::kReadSubmission, std::bind_front(ListSubmissions, std::cref(context)));
  routes.Get(R"(/v1/submissions/(\d{1,18}))", Action::kReadSubmission,
             std::bind_front(GetSubmission, std::cref(context)));
  routes.Post("/v1/submissions", Action::kSubmit, std::bind_front(CreateSubmission, std::cref(context)));
  routes.Post(R"(/v1/submissions/(\d{1,18})/cancel)", Action::kCancel,
              std::bind_front(CancelSubmission, std::cref(context)));
  routes.Post(R"(/v1/submissions/(\d{1,18})/marks)", Action::kMark,
              std::bind_front(MarkSubmission, std::cref(context)));
  routes.PostUpload("/v1/artefacts", Action::kUpload,
                    {.most = context.config.artefacts.archive_bytes,
                     .upload = true,
                     .types = {"application/x-tar", "application/tar", "application/gzip",
                               "application/x-gzip", "application/zstd", "application/zip",
                               "application/octet-stream"}},
                    std::bind_front(UploadArtefact, std::cref(context)));
}

}  // namespace myograde::server
