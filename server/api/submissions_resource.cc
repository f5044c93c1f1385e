#include "server/api/resources.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>

#include "server/api/redaction.h"
#include "server/base/error_code.h"
#include "server/base/names.h"
#include "server/base/ip_address.h"
#include "server/grading/leaderboard.h"
#include "server/http/http_server.h"
#include "server/store/damage.h"

namespace myograde::server {
namespace {

// The name that a team has, or will have once there is one: all forms of a name are one team.
std::string NameOf(const Transaction& reader, const std::string& team) {
  const std::string known = reader.teams.NameOf(team);
  return CleanName(known, "the team's name").value_or(known);
}

// Whether the settings give the team to somebody, who need not have submitted anything yet.
bool IsGiven(const Transaction& reader, const AccessConfig& access, const std::string& team) {
  return std::any_of(access.users.begin(), access.users.end(), [&](const UserRule& rule) {
    return !rule.team.empty() && NameOf(reader, rule.team) == team;
  });
}

// Whether the caller may act for the team called `team`, and if so, what makes them its first
// member: nullopt if nothing has to. NotFoundError: it is not theirs, and they can't found it.
absl::StatusOr<std::optional<Founding>> FoundingFor(const ApiContext& context,
                                                    const std::string& team) {
  const Identity& caller = Caller();
  if (CallerIsOrganiser()) {
    // Whoever submits for a new team is its first member, organisers too; they may also submit for
    // teams of others.
    if (!caller.may_found_team) return std::optional<Founding>();
    return std::optional(Founding{caller.key, INT64_MAX, /*needed=*/false});
  }
  std::optional<Founding> founding;
  RETURN_IF_ERROR(context.readers.Read([&](const Transaction& reader) {
    if (!caller.may_found_team) return RequireTeam(reader, team);
    const std::string known = reader.teams.NameOf(team);
    if (caller.teams.contains(known)) return absl::OkStatus();
    if (!IsGiven(reader, context.config.access, NameOf(reader, team))) {
      founding = {caller.key, context.config.access.teams_of_a_user, /*needed=*/true};
      return absl::OkStatus();
    }
    NoteDenial("another team's");
    return WithErrorCode(
        absl::FailedPreconditionError(absl::StrCat(
            "team \"", known, "\" belongs to others; choose another name, or ask an organiser to "
            "add you to it")),
        kForbiddenCode);
  }));
  return founding;
}

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
  RETURN_IF_ERROR(CheckParameters(request, {"team", "track"}));
  if (request.HasParam("team") != request.HasParam("track")) {
    return absl::InvalidArgumentError("\"team\" and \"track\" go together: give both or none");
  }
  const std::string team = request.Param("team");
  if (request.HasParam("team")) RETURN_IF_ERROR(CheckTeam(team));
  return UploadRequest{.from = {CallerKey(), team, CallerIsOrganiser()},
                       .track = request.Param("track"),
                       .stopping = HttpServer::Stopping};
}

// For an upload without a team: one of the caller's must still be allowed to hand something in.
absl::Status CheckSomeTeam(ReaderPool& readers) {
  if (CallerIsOrganiser() || Caller().teams.empty()) return absl::OkStatus();
  return readers.Read([](const Transaction& reader) {
    absl::Status refusal;
    for (const std::string& team : Caller().teams) {
      refusal = reader.teams.Check(team);
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
  if (!received.ok()) return ToTeamError(received.status(), upload.from.team);
  const ArtefactRow& artefact = received->artefact;
  return ApiAnswer{received->is_new ? 201 : 200,
                   {{"artefact", artefact.hash},
                    {"name", artefact.name},
                    {"command", artefact.command},
                    {"runtimes", artefact.runtimes},
                    {"env", artefact.environment},
                    {"adapter", TextOrNull(artefact.adapter)},
                    {"extra_observations", artefact.extra_observations},
                    {"image", artefact.image ? PolicyImageToJson(*artefact.image) : Json()},
                    {"bytes", artefact.bytes},
                    {"files", artefact.files},
                    {"new", received->is_new}}};
}

absl::StatusOr<Json> HistoryToJson(const Transaction& reader, int64_t submission,
                                   int64_t evaluation) {
  ASSIGN_OR_RETURN(std::vector<TransitionRow> rows,
                   reader.evaluations.Transitions("submission", submission));
  ASSIGN_OR_RETURN(std::vector<TransitionRow> more,
                   reader.evaluations.Transitions("evaluation", evaluation));
  rows.insert(rows.end(), more.begin(), more.end());
  Json history = Json::array();
  for (const TransitionRow& row : rows) {
    history.push_back(
        {{"at", TimeToJson(row.at)},
         {"of", row.entity},
         {"from", TextOrNull(row.from)},
         {"to", row.to},
         {"who", row.who},
         // Of a submission, it tells who else submitted the same bytes.
         {"why",
          row.entity == "submission" && !CallerIsOrganiser() ? Json() : TextOrNull(row.why)}});
  }
  return history;
}

// Null as long as a job waits for a node.
Json HostOf(const LiveLease* live) {
  if (live == nullptr) return HostName();
  // One that has not begun waits for a node.
  if (live->site.job.empty()) return live->begun ? Json(HostName()) : Json();
  return TextOrNull(live->site.node);
}

// The attempts of a block that have ended.
Json AttemptsToJson(const std::vector<AttemptRow>& runs, int64_t block) {
  Json attempts = Json::array();
  for (const AttemptRow& run : runs) {
    if (run.block != block) continue;
    attempts.push_back({{"attempt", run.attempt},
                        {"node", TextOrNull(run.node)},
                        {"job", TextOrNull(run.job)},
                        {"began_at", TimeToJson(run.began_at)},
                        {"ended_at", TimeToJson(run.ended_at)},
                        {"cpu_s", run.cpu_s},
                        {"energy_j", run.energy_j ? Json(*run.energy_j) : Json()},
                        {"how", EnumName(run.how)}});
  }
  return attempts;
}

Json BlockToJson(const BlockRow& block, const LiveLease* live) {
  const bool running = block.state == BlockState::kRunning;
  return {{"block", block.id},
          {"first", block.first},
          {"last", block.last},
          {"state", EnumName(block.state)},
          {"slot", running ? Json(block.slot) : Json()},
          {"attempt", block.attempt},
          {"faults", block.faults},
          {"episode", running && live ? Json(live->episode) : Json()},
          {"step", running && live ? Json(live->step) : Json()},
          {"host", running ? HostOf(live) : Json()},
          {"job", running && live ? TextOrNull(live->site.job) : Json()},
          {"begun", running && live ? Json(live->begun) : Json()},
          {"process", running && live ? Json(live->process) : Json()},
          {"started_at", TimeToJson(block.started_at)},
          {"deadline_at", TimeToJson(block.deadline_at)},
          {"running_wall_s", running && live ? Json(absl::ToDoubleSeconds(live->running)) : Json()},
          {"silent_wall_s", running && live ? Json(absl::ToDoubleSeconds(live->silent)) : Json()},
          {"detail", TextOrNull(block.detail)}};
}

// The answer to GET /v1/submissions/ID. NotFoundError: there is no such submission.
absl::StatusOr<Json> SubmissionStatus(const Transaction& reader, const ApiContext& context,
                                      int64_t id) {
  ASSIGN_OR_RETURN(SubmissionRow row, reader.submissions.Find(id));
  ASSIGN_OR_RETURN(const std::vector<EvaluationRow> evaluations, reader.evaluations.Of(id));
  const EvaluationRow& original = evaluations.front();
  ASSIGN_OR_RETURN(const std::vector<BlockRow> blocks, reader.blocks.Of(original.id));
  ASSIGN_OR_RETURN(const std::vector<AttemptRow> runs, reader.blocks.ListAttempts(original.id));
  ASSIGN_OR_RETURN(Json history, HistoryToJson(reader, id, original.id));
  const Visibility visibility = FindPhaseVisibility(reader, context, row.phase);
  const EpisodeCounts counts = reader.episodes.Counts(original.id, !visibility.progress);
  Json json = SubmissionToJson(row, original, counts);
  const QueueOutlook outlook = AddOutlook(context, original, counts, json);
  json["reason"] = TextOrNull(original.reason);
  json["owner"] = TextOrNull(outlook.owner);
  json["deadline_at"] = Ahead(outlook.deadline, context.clock.Now());
  json["history"] = std::move(history);
  std::set<int64_t> ids;
  for (const BlockRow& block : blocks) ids.insert(block.id);
  const std::map<int64_t, LiveLease> running = context.engine.Running(&ids);
  json["blocks"] = Json::array();
  for (const BlockRow& block : blocks) {
    const auto live = running.find(block.id);
    json["blocks"].push_back(BlockToJson(block, live == running.end() ? nullptr : &live->second));
    json["blocks"].back()["attempts"] = AttemptsToJson(runs, block.id);
  }
  json["marks"] = MarksToJson(reader.Board().MarkHistory(id));
  json["evaluations"] = Json::array();
  for (const EvaluationRow& evaluation : evaluations) {
    if (!CallerSees(reader, evaluation.rejudge)) continue;
    json["evaluations"].push_back({{"evaluation", evaluation.id},
                                   {"kind", EnumName(evaluation.kind)},
                                   {"state", EnumName(evaluation.state)},
                                   {"first", evaluation.first},
                                   {"last", evaluation.last},
                                   {"rejudge", IdOrNull(evaluation.rejudge)},
                                   {"config", evaluation.config}});
  }
  RedactStatus(json, visibility);
  return json;
}

absl::StatusOr<Json> ListedToJson(const Transaction& reader, const ApiContext& context,
                                  const SubmissionRow& row) {
  ASSIGN_OR_RETURN(const EvaluationRow original, reader.evaluations.Original(row.id));
  const Visibility visibility = FindPhaseVisibility(reader, context, row.phase);
  Json json = SubmissionToJson(row, original, reader.episodes.Counts(original.id, !visibility.progress));
  RedactListed(json, visibility);
  return json;
}

ApiResult ListSubmissions(const ApiContext& context, const Transaction& reader,
                          const Request& request) {
  ASSIGN_OR_RETURN(SubmissionFilter filter, ParseFilter(request));
  if (!CallerIsOrganiser()) filter.teams = Caller().teams;
  filter.team = reader.teams.NameOf(filter.team);
  const Listed<SubmissionRow> found = reader.submissions.List(filter);
  Json list = Json::array();
  for (const SubmissionRow& row : found.rows) {
    absl::StatusOr<Json> json = ListedToJson(reader, context, row);
    if (IsLeftOut(json.status())) continue;
    if (!json.ok()) return json.status();
    list.push_back(*std::move(json));
  }
  ApiAnswer answer{200, {{"submissions", std::move(list)}}};
  AddNextPage(request, found.found() == filter.limit, found.last_id, answer);
  return answer;
}

ApiResult StatusAnswer(const ApiContext& context, int64_t submission) {
  ASSIGN_OR_RETURN(Json body, ReadStore(context, [&](const Transaction& reader) {
    return SubmissionStatus(reader, context, submission);
  }));
  return ApiAnswer{200, std::move(body)};
}

ApiResult GetSubmission(const ApiContext& context, const Transaction& reader,
                        const Request& request) {
  RETURN_IF_ERROR(RequireSubmission(reader, ReadId(request)));
  ASSIGN_OR_RETURN(Json body, SubmissionStatus(reader, context, ReadId(request)));
  return ApiAnswer{200, std::move(body)};
}

ApiResult CreateSubmission(const ApiContext& context, const Request& request, const Json& body) {
  ASSIGN_OR_RETURN(SubmitRequest asked, ParseSubmit(body));
  ASSIGN_OR_RETURN(RequestKey key, ReadRequestKey(request, body));
  asked.key = std::move(key);
  ASSIGN_OR_RETURN(std::optional<Founding> founding, FoundingFor(context, asked.team));
  asked.founding = std::move(founding);
  asked.organiser = CallerIsOrganiser();
  const absl::StatusOr<Accepted> accepted = context.admission.Submit(asked, CallerKey());
  if (!accepted.ok()) return ToTeamError(accepted.status(), asked.team);
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
  const int64_t id = ReadId(request);
  bool charge = false;
  RETURN_IF_ERROR(context.readers.Read([&](const Transaction& reader) -> absl::Status {
    RETURN_IF_ERROR(RequireSubmission(reader, id));
    ASSIGN_OR_RETURN(const SubmissionRow row, reader.submissions.Find(id));
    // Practice is of no phase, and organisers see all: neither is charged for a cancel as such.
    charge = !FindPhaseVisibility(reader, context, row.phase).progress;
    return absl::OkStatus();
  }));
  ASSIGN_OR_RETURN(
      const CancelReport report,
      context.engine.Cancel({.submission = id,
                             .reruns = CallerIsOrganiser(),
                             .charge = charge,
                             .why = reason,
                             .who = CallerKey()},
                            context.config.http.request));
  NoteAct(absl::StrCat("submission ", id), reason);
  ASSIGN_OR_RETURN(ApiAnswer answer, StatusAnswer(context, id));
  ASSIGN_OR_RETURN(const std::string charged, ReadStore(context, [&](const Transaction& reader) {
    return reader.quotas.ChargedBudget(id);
  }));
  answer.body["cancel"] = {{"killed", report.killed},
                           {"still_ending", report.still_ending},
                           {"took_wall_s", absl::ToDoubleSeconds(report.took)},
                           {"charged", TextOrNull(charged)}};
  return answer;
}

ApiResult MarkSubmission(const ApiContext& context, const Request& request, const Json& body) {
  ConfigReader reader(body, "request");
  const std::string mark = reader.Choice("mark", {kHidden, kDisqualified, kBaseline});
  const bool set = reader.Boolean("set");
  const std::string reason = reader.Has("reason") ? ReadReason(reader) : "";
  if (set && mark == kDisqualified && reason.empty()) {
    reader.Fail("reason", "is missing: a disqualification needs one");
  }
  RETURN_IF_ERROR(reader.Finish());
  const int64_t id = ReadId(request);
  // What can't be answered is not done.
  RETURN_IF_ERROR(context.readers.Read(
      [&](const Transaction& store) { return store.submissions.Find(id).status(); }));
  const auto change = [=, who = CallerKey()](Transaction& writer) {
    return writer.journal.Mark(id, mark, set, who, reason);
  };
  ASSIGN_OR_RETURN(const bool changed, ChangeStore(context, change));
  ApiAnswer answer;
  RETURN_IF_ERROR(context.readers.Read([&](const Transaction& store) -> absl::Status {
    ASSIGN_OR_RETURN(const SubmissionRow submission, store.submissions.Find(id));
    answer.body = {{"submission", id},
                   {"team", submission.team},
                   {"track", submission.track},
                   {"profile", submission.profile},
                   {"mark", mark},
                   {"set", set},
                   {"changed", changed},
                   {"marks", MarksToJson(store.Board().MarkHistory(id))}};
    return absl::OkStatus();
  }));
  NoteAct(absl::StrCat("submission ", id),
          absl::StrCat(set ? "" : "not ", mark, reason.empty() ? "" : ": ", reason));
  return answer;
}

}  // namespace

void AddSubmissions(Routes& routes, const ApiContext& context) {
  routes.Get("/v1/submissions", Action::kReadSubmission, Bind(context, ListSubmissions));
  routes.Get(R"(/v1/submissions/(\d{1,18}))", Action::kReadSubmission,
             Bind(context, GetSubmission));
  routes.Post("/v1/submissions", Action::kSubmit, Bind(context, CreateSubmission));
  routes.Post(R"(/v1/submissions/(\d{1,18})/cancel)", Action::kCancel,
              Bind(context, CancelSubmission));
  routes.Post(R"(/v1/submissions/(\d{1,18})/marks)", Action::kMark, Bind(context, MarkSubmission));
  routes.PostUpload(
      "/v1/artefacts", Action::kUpload,
      {.most = context.config.artefacts.archive_bytes,
       .upload = true,
       .types = {"application/x-tar", "application/tar", "application/gzip", "application/x-gzip",
                 "application/zstd", "application/zip", "application/octet-stream"}},
      Bind(context, UploadArtefact));
}

}  // namespace myograde::server
