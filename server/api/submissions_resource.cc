#include "server/api/submissions_resource.h"

#include <functional>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/api/founding.h"
#include "server/api/paging.h"
#include "server/api/phase_sight.h"
#include "server/api/redaction.h"
#include "server/api/requests.h"
#include "server/api/submission_view.h"
#include "server/api/views.h"
#include "server/store/damage.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

}  // namespace

void SubmissionsResource::Install(Routes& routes) {
  using Self = SubmissionsResource;
  routes.Get("/v1/submissions", Action::kReadSubmission, std::bind_front(&Self::List, this));
  routes.Get(R"(/v1/submissions/(\d{1,18}))", Action::kReadSubmission,
             std::bind_front(&Self::Get, this));
  routes.Post("/v1/submissions", Action::kSubmit, std::bind_front(&Self::Submit, this));
  routes.Post(R"(/v1/submissions/(\d{1,18})/cancel)", Action::kCancel,
              std::bind_front(&Self::Cancel, this));
  routes.Post(R"(/v1/submissions/(\d{1,18})/marks)", Action::kMark,
              std::bind_front(&Self::Mark, this));
}

ApiResult SubmissionsResource::List(const Request& request) const {
  ASSIGN_OR_RETURN(SubmissionFilter filter, ParseFilter(request));
  if (!CallerIsOrganiser()) filter.teams = Caller().teams;
  Json list = Json::array();
  Listed<SubmissionRow> found;
  bool more = false;
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) {
    filter.team = reader.TeamOf(filter.team);
    found = reader.Submissions(filter);
    more = std::ssize(found.rows) + std::ssize(found.damaged) == filter.limit;
    for (const SubmissionRow& row : found.rows) {
      const absl::StatusOr<EvaluationRow> original = reader.Original(row.id);
      if (original.ok()) {
        ASSIGN_OR_RETURN(const Visibility sight, SightOfPhase(reader, context_, row.phase));
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

ApiResult SubmissionsResource::StatusAnswer(int64_t submission) const {
  ApiAnswer answer;
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(answer.body, SubmissionStatus(reader, context_, submission));
    return absl::OkStatus();
  }));
  return answer;
}

ApiResult SubmissionsResource::Get(const Request& request) const {
  const absl::Status own = context_.readers.Read(
      [&](Reader& reader) { return RequireSubmission(reader, IdOf(request)); });
  RETURN_IF_ERROR(own);
  return StatusAnswer(IdOf(request));
}

ApiResult SubmissionsResource::Submit(const Request& request, const Json& body) const {
  ASSIGN_OR_RETURN(SubmitRequest asked, ParseSubmit(body));
  ASSIGN_OR_RETURN(RequestKey key, ReadRequestKey(request, body));
  asked.key = std::move(key);
  ASSIGN_OR_RETURN(std::optional<Founding> founding, FoundingFor(context_, asked.team));
  asked.founding = std::move(founding);
  asked.organiser = CallerIsOrganiser();
  const absl::StatusOr<Accepted> accepted = context_.admission.Submit(asked, CallerKey());
  if (!accepted.ok()) return TeamErrorOf(accepted.status(), asked.team);
  NoteAct(absl::StrCat("submission ", accepted->submission),
          absl::StrCat("for team ", asked.team, accepted->is_new() ? "" : ", known already"));
  ASSIGN_OR_RETURN(ApiAnswer answer, StatusAnswer(accepted->submission));
  answer.http = accepted->is_new() ? 201 : 200;
  answer.body["linked"] = accepted->linked;
  answer.body["repeated"] = accepted->repeated;
  return answer;
}

ApiResult SubmissionsResource::Cancel(const Request& request, const Json& body) const {
  ASSIGN_OR_RETURN(const std::string reason, ParseCancel(body));
  const int64_t id = IdOf(request);
  absl::StatusOr<Visibility> sight = Visibility{};
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) {
    RETURN_IF_ERROR(RequireSubmission(reader, id));
    ASSIGN_OR_RETURN(const SubmissionRow row, reader.Submission(id));
    // Practice is of no phase, and organisers see all: neither is charged for a cancel as such.
    sight = SightOfPhase(reader, context_, row.phase);
    return sight.status();
  }));
  ASSIGN_OR_RETURN(const CancelReport report,
                   context_.engine.Cancel(id, /*reruns=*/CallerIsOrganiser(), /*charge=*/!sight->progress, reason,
                                          CallerKey(), context_.config.http.request));
  NoteAct(absl::StrCat("submission ", id), reason);
  ASSIGN_OR_RETURN(ApiAnswer answer, StatusAnswer(id));
  std::string charged;
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) {
    charged = reader.ChargedBudget(id);
    return absl::OkStatus();
  }));
  answer.body["cancel"] = {{"killed", report.killed},
                            {"still_ending", report.still_ending},
                            {"took_wall_s", absl::ToDoubleSeconds(report.took)},
                            {"charged", TextOrNull(charged)}};
  return answer;
}

ApiResult SubmissionsResource::Mark(const Request& request, const Json& body) const {
  ASSIGN_OR_RETURN(MarkRequest wanted, ParseMark(body));
  const int64_t id = IdOf(request);
  // What can't be answered is not done.
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) {
    absl::Status readable = reader.Submission(id).status();
    readable.Update(reader.MarkHistory(id).status());
    return readable;
  }));
  const absl::StatusOr<bool> changed = context_.engine.Change<bool>(
      [id, who = CallerKey(), mark = wanted](Writer& writer) {
        return writer.Mark(id, mark.mark, mark.set, who, mark.reason);
      },
      context_.config.http.request);
  absl::Status status = changed.status();
  ApiAnswer answer;
  if (status.ok()) {
    status = context_.readers.Read([&](Reader& reader) -> absl::Status {
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

}  // namespace myograde::server
