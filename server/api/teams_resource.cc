#include "server/api/resources.h"

#include <algorithm>
#include <functional>
#include <set>
#include <string>
#include <tuple>
#include <utility>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/api/paging.h"
#include "server/api/requests.h"
#include "server/api/views.h"
#include "server/base/names.h"
#include "server/base/peer_key.h"
#include "server/store/quota.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr char kTeam[] = "/v1/teams/([^]{1,64})";  // bytes; a name may hold any character

std::string TeamIn(const Request& request) { return request.matches[1]; }

// "" if it is left out.
std::string ReasonOf(ConfigReader& reader, bool required = false) {
  return required || reader.Has("reason") ? ReadReason(reader) : "";
}

Json TeamToJson(const TeamRow& team) {
  return {{"team", team.name},
          {"created_at", TimeToJson(team.created_at)},
          {"banned", team.banned},
          {"merged_into", TextOrNull(team.merged_into)},
          {"other_names", team.other_names},
          {"members", team.members}};
}

void AddHistory(Reader& reader, const std::string& team, Json& body) {
  const Listed<MemberRow> members = reader.Members(team);
  body["memberships"] = Json::array();
  for (const MemberRow& member : members.rows) {
    body["memberships"].push_back({{"person", member.person},
                                   {"since_at", TimeToJson(member.since)},
                                   {"who", member.who}});
  }
  const Listed<TeamEventRow> events = reader.TeamEvents(team);
  body["events"] = Json::array();
  for (const TeamEventRow& event : events.rows) {
    body["events"].push_back({{"at", TimeToJson(event.at)},
                              {"team", event.team},
                              {"event", event.event},
                              {"detail", TextOrNull(event.detail)},
                              {"who", event.who},
                              {"reason", TextOrNull(event.why)}});
  }
  std::vector<Damage> damaged = members.damaged;
  damaged.insert(damaged.end(), events.damaged.begin(), events.damaged.end());
  body["unreadable"] = DamagedToJson(damaged);
}

absl::StatusOr<Json> WholeTeam(Reader& reader, const std::string& name) {
  ASSIGN_OR_RETURN(const TeamRow team, reader.Team(name));
  Json body = TeamToJson(team);
  body["submissions"] = reader.SubmissionsOf(team.name);
  AddHistory(reader, team.name, body);
  return body;
}

int64_t Used(const BudgetUse& use) { return use.charged + use.open; }

Json SumToJson(const BudgetUse& team, const BudgetUse& into, int64_t limit) {
  const BudgetUse after = {team.charged + into.charged, team.open + into.open,
                           team.granted + into.granted};
  return {{"limit", limit},
          {"granted", after.granted},
          {"used_by_team", Used(team)},
          {"used_by_into", Used(into)},
          {"used", Used(after)},
          {"left", std::max<int64_t>(after.left(limit), 0)}};
}

// Of all budgets of a track, or of those of a phase.
Json SumsToJson(const QuotaUse& team, const QuotaUse& into, const QuotaLimits& limits,
                bool of_a_phase) {
  Json sums = Json::object();
  for (const Budget budget : kBudgets) {
    if (of_a_phase && budget == Budget::kPractice) continue;  // it belongs to the track
    sums[std::string(BudgetName(budget))] = {
        {"per_day", SumToJson(team.today_of(budget), into.today_of(budget),
                              limits.of(budget).per_day)},
        {"total", SumToJson(team.total_of(budget), into.total_of(budget),
                            limits.of(budget).total)}};
  }
  return sums;
}

int64_t ActiveTokens(Reader& reader, const std::string& team) {
  const std::vector<TokenRow> tokens = reader.Tokens().rows;
  return std::count_if(tokens.begin(), tokens.end(), [&](const TokenRow& token) {
    return token.team == team && token.revoked_at == 0;
  });
}

ApiResult ListTeams(const ApiContext& context, const Request& request) {
  absl::Status status = CheckParameters(request, {"before", "limit"});
  const absl::StatusOr<Page> page = ReadPage(request);
  status.Update(page.status());
  RETURN_IF_ERROR(status);
  ApiAnswer answer;
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) {
    const Listed<TeamRow> listed = reader.Teams(page->before, page->limit);
    answer.body = {{"teams", Json::array()}, {"unreadable", DamagedToJson(listed.damaged)}};
    for (const TeamRow& team : listed.rows) answer.body["teams"].push_back(TeamToJson(team));
    AddNextPage(request, *page, listed, answer);
    return absl::OkStatus();
  }));
  return answer;
}

ApiResult GetTeam(const ApiContext& context, const Request& request) {
  absl::Status status = CheckParameters(request, {});
  if (status.ok()) status = CheckTeam(TeamIn(request));
  RETURN_IF_ERROR(status);
  ASSIGN_OR_RETURN(Json body, context.readers.Read<Json>([&](Reader& reader) -> absl::StatusOr<Json> {
        RETURN_IF_ERROR(RequireTeam(reader, TeamIn(request)));
        return WholeTeam(reader, TeamIn(request));
      }));
  return ApiAnswer{200, std::move(body)};
}

// Does it, and answers with the team as it is afterwards. `change` returns whether it changed
// anything.
ApiResult ChangeTeam(const ApiContext& context, const std::string& team,
                     std::function<absl::StatusOr<bool>(Writer&)> change, int http = 200) {
  const absl::StatusOr<bool> changed =
      context.engine.ChangeTeams(std::move(change), context.config.http.request);
  if (!changed.ok()) return TeamErrorOf(changed.status(), team);
  absl::StatusOr<Json> body =
      context.readers.Read<Json>([&](Reader& reader) { return WholeTeam(reader, team); });
  if (!body.ok()) return TeamErrorOf(body.status(), team);
  (*body)["changed"] = *changed;
  return ApiAnswer{http, *std::move(body)};
}

ApiResult CreateTeam(const ApiContext& context, const Request&, const Json& body) {
  ConfigReader reader(body, "request");
  const std::string team = reader.String("team");
  const std::string why = ReasonOf(reader);
  absl::Status status = reader.Finish();
  if (status.ok()) status = CheckTeam(team);
  RETURN_IF_ERROR(status);
  NoteAct(absl::StrCat("team ", team), "created");
  return ChangeTeam(context, team,
                [team, why, who = CallerKey()](Writer& writer) -> absl::StatusOr<bool> {
                  RETURN_IF_ERROR(writer.CreateTeam(team, who, why).status());
                  return true;
                },
                201);
}

ApiResult RenameTeam(const ApiContext& context, const Request& request, const Json& body) {
  ConfigReader reader(body, "request");
  const std::string name = reader.String("name");
  const std::string why = ReasonOf(reader);
  const std::string team = TeamIn(request);
  absl::Status status = reader.Finish();
  if (status.ok()) status = CheckTeam(team);
  RETURN_IF_ERROR(status);
  NoteAct(absl::StrCat("team ", team), absl::StrCat("renamed to ", name));
  return ChangeTeam(context, team, [=, who = CallerKey()](Writer& writer) {
    return writer.RenameTeam(team, name, who, why);
  });
}

ApiResult SetTeamMember(const ApiContext& context, const Request& request, const Json& body) {
  ConfigReader reader(body, "request");
  const std::string text = reader.String("person");
  const bool belongs = reader.Boolean("belongs");
  const std::string team = TeamIn(request);
  absl::Status status = reader.Finish();
  if (status.ok()) status = CheckTeam(team);
  RETURN_IF_ERROR(status);
  ASSIGN_OR_RETURN(const std::string person, PersonNamed(text));
  NoteAct(absl::StrCat("team ", team),
          absl::StrCat(person, belongs ? " is a member" : " is no member any more"));
  return ChangeTeam(context, team, [=, person = person, who = CallerKey()](Writer& writer) {
    return writer.SetMember(team, person, belongs, who);
  });
}

ApiResult BanTeam(const ApiContext& context, const Request& request, const Json& body) {
  ConfigReader reader(body, "request");
  const bool banned = reader.Boolean("banned");
  const std::string why = ReasonOf(reader, /*required=*/banned);
  const std::string team = TeamIn(request);
  absl::Status status = reader.Finish();
  if (status.ok()) status = CheckTeam(team);
  RETURN_IF_ERROR(status);
  NoteAct(absl::StrCat("team ", team),
          absl::StrCat(banned ? "banned" : "not banned any more", why.empty() ? "" : ": ", why));
  return ChangeTeam(context, team, [=, who = CallerKey()](Writer& writer) {
    return writer.BanTeam(team, banned, who, why);
  });
}

// What the two teams have used, and what one team of both would have used.
absl::StatusOr<Json> ConsequencesOfMerge(const ApiContext& context, const std::string& team,
                                         const std::string& into) {
  Json body;
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) -> absl::Status {
    RETURN_IF_ERROR(reader.CheckMerge(team, into));
    const std::string from = reader.TeamOf(team);
    const std::string to = reader.TeamOf(into);
    std::set<std::string> members;
    for (const std::string& one : {from, to}) {
      ASSIGN_OR_RETURN(const TeamRow row, reader.Team(one));
      members.insert(row.members.begin(), row.members.end());
    }
    const int64_t submissions = reader.SubmissionsOf(from);
    body = {{"team", from},
            {"into", to},
            {"submissions_of_team", submissions},
            {"submissions", submissions + reader.SubmissionsOf(to)},
            {"tokens_of_team", ActiveTokens(reader, from)},
            {"members", members},
            {"tracks", Json::array()},
            {"phases", Json::array()}};
    const int64_t now = absl::ToUnixMillis(context.clock.Now());
    for (const auto& [track, offer] : context.tracks.entries()) {
      Json sums = SumsToJson(reader.Quota(from, track, now), reader.Quota(to, track, now),
                             context.config.quota.of(track).quota, /*of_a_phase=*/false);
      sums["track"] = track;
      body["tracks"].push_back(std::move(sums));
    }
    for (const PhasePtr& phase : context.phases.entries()) {
      const auto& [name, track] = std::tie(phase->config.name, phase->config.track);
      Json sums = SumsToJson(reader.Quota(from, track, now, name),
                             reader.Quota(to, track, now, name),
                             PhaseRules(phase->config, context.config.quota.of(track)).quota,
                             /*of_a_phase=*/true);
      sums["phase"] = name;
      sums["track"] = track;
      body["phases"].push_back(std::move(sums));
    }
    return absl::OkStatus();
  }));
  return body;
}

ApiResult MergeTeams(const ApiContext& context, const Request& request, const Json& body) {
  ConfigReader reader(body, "request");
  const std::string into = reader.String("into");
  const bool dry_run = reader.Has("dry_run") && reader.Boolean("dry_run");
  const std::string why = ReasonOf(reader);
  const std::string team = TeamIn(request);
  absl::Status status = reader.Finish();
  for (const std::string& name : {team, into}) {
    if (status.ok()) status = CheckTeam(name);
  }
  RETURN_IF_ERROR(status);
  absl::StatusOr<Json> answer = ConsequencesOfMerge(context, team, into);
  if (answer.ok() && !dry_run) {
    status = context.engine
                 .ChangeTeams(
                     [=, who = CallerKey()](Writer& writer) -> absl::StatusOr<bool> {
                       RETURN_IF_ERROR(writer.MergeTeams(team, into, who, why));
                       return true;
                     },
                     context.config.http.request)
                 .status();
  }
  status.Update(answer.status());
  RETURN_IF_ERROR(status);
  (*answer)["merged"] = !dry_run;
  NoteAct(absl::StrCat("team ", team),
          absl::StrCat(dry_run ? "to be merged into " : "merged into ", into));
  return ApiAnswer{200, *std::move(answer)};
}

}  // namespace

void AddTeams(Routes& routes, const ApiContext& context) {
  const std::string team = kTeam;
  routes.Get("/v1/teams", Action::kManageTeams, std::bind_front(ListTeams, std::cref(context)));
  routes.Post("/v1/teams", Action::kManageTeams, std::bind_front(CreateTeam, std::cref(context)));
  routes.Get(team, Action::kReadTeam, std::bind_front(GetTeam, std::cref(context)));
  routes.Post(team + "/rename", Action::kManageTeams,
              std::bind_front(RenameTeam, std::cref(context)));
  routes.Post(team + "/members", Action::kManageTeams,
              std::bind_front(SetTeamMember, std::cref(context)));
  routes.Post(team + "/merge", Action::kManageTeams,
              std::bind_front(MergeTeams, std::cref(context)));
  routes.Post(team + "/ban", Action::kManageTeams,
              std::bind_front(BanTeam, std::cref(context)));
}

}  // namespace myograde::server
