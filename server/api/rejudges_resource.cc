#include "server/api/rejudges_resource.h"

#include <functional>
#include <string>
#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"
#include "server/api/paging.h"
#include "server/api/rejudge_document.h"
#include "server/api/rejudge_plan.h"
#include "server/api/rejudge_view.h"
#include "server/api/requests.h"
#include "server/api/views.h"
#include "server/challenge/board_configs.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

std::string SubjectOf(int64_t id) { return absl::StrCat("rejudge ", id); }

Json PlanToJson(const RejudgePlan& plan) {
  return {{"submissions", plan.submissions},
          {"facts", plan.facts},
          {"play", plan.play},
          {"without_files", plan.without_files}};
}

}  // namespace

void RejudgesResource::Install(Routes& routes) {
  using Self = RejudgesResource;
  routes.Get("/v1/rejudges", Action::kRejudge, std::bind_front(&Self::List, this));
  routes.Post("/v1/rejudges", Action::kRejudge, std::bind_front(&Self::Create, this));
  routes.Get(R"(/v1/rejudges/(\d{1,18}))", Action::kRejudge, std::bind_front(&Self::Get, this));
  routes.Post(R"(/v1/rejudges/(\d{1,18})/apply)", Action::kRejudge,
              std::bind_front(&Self::Apply, this));
  routes.Post(R"(/v1/rejudges/(\d{1,18})/drop)", Action::kRejudge,
              std::bind_front(&Self::Drop, this));
}

ApiResult RejudgesResource::List(const Request& request) const {
  absl::Status status = CheckParameters(request, {"before", "limit"});
  const absl::StatusOr<Page> page = ReadPage(request);
  status.Update(page.status());
  RETURN_IF_ERROR(status);
  ApiAnswer answer;
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) -> absl::Status {
    Listed<RejudgeRow> listed = reader.Rejudges(page->before, page->limit);
    answer.body["rejudges"] = Json::array();
    for (const RejudgeRow& row : listed.rows) {
      ASSIGN_OR_RETURN(Json json, RejudgeToJson(reader, row));
      answer.body["rejudges"].push_back(std::move(json));
    }
    answer.body["unreadable"] = DamagedToJson(listed.damaged);
    AddNextPage(request, *page, listed, answer);
    return absl::OkStatus();
  }));
  return answer;
}

ApiResult RejudgesResource::Get(const Request& request) const {
  absl::Status status = CheckParameters(request, {"changes"});
  const std::string changes = request.Param("changes");
  if (!changes.empty() && changes != "0" && changes != "1") {
    status.Update(absl::InvalidArgumentError("\"changes\" must be 0 or 1"));
  }
  RETURN_IF_ERROR(status);
  ApiAnswer answer;
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const RejudgeRow row, reader.Rejudge(IdOf(request)));
    ASSIGN_OR_RETURN(answer.body, WholeRejudgeToJson(reader, row));
    return changes == "1" ? AddRejudgeChanges(reader, row, answer.body) : absl::OkStatus();
  }));
  return answer;
}

ApiResult RejudgesResource::Show(int64_t id, int http, Json more) const {
  ApiAnswer answer{http};
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const RejudgeRow row, reader.Rejudge(id));
    absl::StatusOr<Json> json = WholeRejudgeToJson(reader, row);
    if (json.ok()) answer.body = *std::move(json);
    return json.status();
  }));
  answer.body.update(more);
  return answer;
}

ApiResult RejudgesResource::Create(const Request&, const Json& body) const {
  ASSIGN_OR_RETURN(const RejudgeRequest asked, ParseRejudge(body));
  ASSIGN_OR_RETURN(const NewRejudge rejudge, context_.readers.Read<NewRejudge>(
      [&](Reader& reader) { return MakeRejudge(reader, context_, asked); }));
  ASSIGN_OR_RETURN(const SignRejudge sign, RejudgeSigner(context_));
  ASSIGN_OR_RETURN(const CreatedRejudge created,
                   context_.engine.CreateRejudge(rejudge, sign, CallerKey(), context_.config.http.request));
  const int64_t id = created.rejudge.id;
  NoteAct(SubjectOf(id), "created");
  return Show(id, 201, {{"plan", PlanToJson(created.plan)}});
}

absl::StatusOr<std::string> RejudgesResource::ConfigInForce(int64_t id) const {
  std::string hash;
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const RejudgeRow row, reader.Rejudge(id));
    ASSIGN_OR_RETURN(const TrackPtr live,
                     TrackInForce(reader, context_, row.phase, row.track, row.profile));
    hash = live->config.hash;
    return absl::OkStatus();
  }));
  return hash;
}

AfterRejudge RejudgesResource::PlayFromNowOn() const {
  return [&context = context_](const RejudgeDone& done) {
    if (done.config_after == done.config_before) return;
    const absl::Status switched = context.readers.Read([&](Reader& reader) {
      return SwitchConfig(reader, done.config_after, context.tracks, context.phases);
    });
    if (switched.ok()) return;
    spdlog::error("rejudge {} is {}, and its board's config is {}; it will be played after a restart, "
                  "but not yet: {}",
                  done.event.rejudge, RejudgeEventName(done.event.event), done.config_after,
                  std::string(switched.message()));
  };
}

ApiResult RejudgesResource::Apply(const Request& request, const Json& body) const {
  ASSIGN_OR_RETURN(ApplyRequest asked, ParseApply(body));
  const int64_t id = IdOf(request);
  ASSIGN_OR_RETURN(std::string in_force, ConfigInForce(id));
  ASSIGN_OR_RETURN(const SignRejudge sign, RejudgeSigner(context_));
  ASSIGN_OR_RETURN(const RejudgeDone done, context_.engine.ApplyRejudge(
      {id, asked.reason, std::move(asked.without), std::move(in_force)}, sign, CallerKey(),
      context_.config.http.request, PlayFromNowOn()));
  NoteAct(SubjectOf(id), "applied");
  return Show(id, 200, {{"config_before", done.config_before},
                        {"config_after", done.config_after}});
}

ApiResult RejudgesResource::Drop(const Request& request, const Json& body) const {
  ASSIGN_OR_RETURN(const std::string reason, ParseReason(body));
  const int64_t id = IdOf(request);
  ASSIGN_OR_RETURN(std::string in_force, ConfigInForce(id));
  ASSIGN_OR_RETURN(const SignRejudge sign, RejudgeSigner(context_));
  ASSIGN_OR_RETURN(const RejudgeDone done, context_.engine.DropRejudge(
      {id, reason, {}, std::move(in_force)}, sign, CallerKey(), context_.config.http.request,
      PlayFromNowOn()));
  NoteAct(SubjectOf(id), "dropped");
  return Show(id, 200, {{"config_before", done.config_before},
                        {"config_after", done.config_after},
                        {"accepted_under_to_config", done.stay}});
}

}  // namespace myograde::server
