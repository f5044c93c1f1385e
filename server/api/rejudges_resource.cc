#include "server/api/resources.h"

#include <cstdint>
#include <functional>
#include <string>
#include <utility>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>
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

ApiResult ListRejudges(const ApiContext& context, const Request& request) {
  absl::Status status = CheckParameters(request, {"before", "limit"});
  const absl::StatusOr<Page> page = ReadPage(request);
  status.Update(page.status());
  RETURN_IF_ERROR(status);
  ApiAnswer answer;
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) -> absl::Status {
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

ApiResult GetRejudge(const ApiContext& context, const Request& request) {
  absl::Status status = CheckParameters(request, {"changes"});
  const std::string changes = request.Param("changes");
  if (!changes.empty() && changes != "0" && changes != "1") {
    status.Update(absl::InvalidArgumentError("\"changes\" must be 0 or 1"));
  }
  RETURN_IF_ERROR(status);
  ApiAnswer answer;
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const RejudgeRow row, reader.Rejudge(IdOf(request)));
    ASSIGN_OR_RETURN(answer.body, WholeRejudgeToJson(reader, row));
    return changes == "1" ? AddRejudgeChanges(reader, row, answer.body) : absl::OkStatus();
  }));
  return answer;
}

// The rejudge as it is now, with `more` keys.
ApiResult ShowRejudge(const ApiContext& context, int64_t id, int http, Json more) {
  ApiAnswer answer{http};
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const RejudgeRow row, reader.Rejudge(id));
    absl::StatusOr<Json> json = WholeRejudgeToJson(reader, row);
    if (json.ok()) answer.body = *std::move(json);
    return json.status();
  }));
  answer.body.update(more);
  return answer;
}

ApiResult CreateRejudge(const ApiContext& context, const Request&, const Json& body) {
  ASSIGN_OR_RETURN(const RejudgeRequest asked, ParseRejudge(body));
  ASSIGN_OR_RETURN(const NewRejudge rejudge, context.readers.Read<NewRejudge>(
      [&](Reader& reader) { return MakeRejudge(reader, context, asked); }));
  ASSIGN_OR_RETURN(const SignRejudge sign, RejudgeSigner(context));
  ASSIGN_OR_RETURN(const CreatedRejudge created,
                   context.engine.CreateRejudge(rejudge, sign, CallerKey(), context.config.http.request));
  const int64_t id = created.rejudge.id;
  NoteAct(SubjectOf(id), "created");
  return ShowRejudge(context, id, 201, {{"plan", PlanToJson(created.plan)}});
}

// The hash of the config in force on its board.
absl::StatusOr<std::string> ConfigInForce(const ApiContext& context, int64_t id) {
  std::string hash;
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const RejudgeRow row, reader.Rejudge(id));
    ASSIGN_OR_RETURN(const TrackPtr live,
                     TrackInForce(reader, context, row.phase, row.track, row.profile));
    hash = live->config.hash;
    return absl::OkStatus();
  }));
  return hash;
}

// Has the daemon play and show the board's new config once an act is written.
AfterRejudge PlayFromNowOn(const ApiContext& context) {
  return [&context = context](const RejudgeDone& done) {
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

ApiResult ApplyRejudge(const ApiContext& context, const Request& request, const Json& body) {
  ASSIGN_OR_RETURN(ApplyRequest asked, ParseApply(body));
  const int64_t id = IdOf(request);
  ASSIGN_OR_RETURN(std::string in_force, ConfigInForce(context, id));
  ASSIGN_OR_RETURN(const SignRejudge sign, RejudgeSigner(context));
  ASSIGN_OR_RETURN(const RejudgeDone done, context.engine.ApplyRejudge(
      {id, asked.reason, std::move(asked.without), std::move(in_force)}, sign, CallerKey(),
      context.config.http.request, PlayFromNowOn(context)));
  NoteAct(SubjectOf(id), "applied");
  return ShowRejudge(context, id, 200, {{"config_before", done.config_before},
                        {"config_after", done.config_after}});
}

ApiResult DropRejudge(const ApiContext& context, const Request& request, const Json& body) {
  ASSIGN_OR_RETURN(const std::string reason, ParseReason(body));
  const int64_t id = IdOf(request);
  ASSIGN_OR_RETURN(std::string in_force, ConfigInForce(context, id));
  ASSIGN_OR_RETURN(const SignRejudge sign, RejudgeSigner(context));
  ASSIGN_OR_RETURN(const RejudgeDone done, context.engine.DropRejudge(
      {id, reason, {}, std::move(in_force)}, sign, CallerKey(), context.config.http.request,
      PlayFromNowOn(context)));
  NoteAct(SubjectOf(id), "dropped");
  return ShowRejudge(context, id, 200, {{"config_before", done.config_before},
                        {"config_after", done.config_after},
                        {"accepted_under_to_config", done.stay}});
}

}  // namespace

void AddRejudges(Routes& routes, const ApiContext& context) {
  routes.Get("/v1/rejudges", Action::kRejudge, std::bind_front(ListRejudges, std::cref(context)));
  routes.Post("/v1/rejudges", Action::kRejudge, std::bind_front(CreateRejudge, std::cref(context)));
  routes.Get(R"(/v1/rejudges/(\d{1,18}))", Action::kRejudge, std::bind_front(GetRejudge, std::cref(context)));
  routes.Post(R"(/v1/rejudges/(\d{1,18})/apply)", Action::kRejudge,
              std::bind_front(ApplyRejudge, std::cref(context)));
  routes.Post(R"(/v1/rejudges/(\d{1,18})/drop)", Action::kRejudge,
              std::bind_front(DropRejudge, std::cref(context)));
}

}  // namespace myograde::server
