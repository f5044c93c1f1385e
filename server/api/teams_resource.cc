#include "server/api/resources.h"

#include <algorithm>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>

#include "server/api/redaction.h"
#include "server/base/peer_key.h"
#include "server/store/quota.h"

namespace myograde::server {
namespace {

constexpr char kTeam[] = "/v1/teams/([^]{1,64})";  // bytes; a name may hold any character

std::string TeamIn(const Request& request) { return request.matches[1]; }

// "" if it is left out.
std::string ReasonOf(ConfigReader& reader, bool required = false) {
  return required || reader.Has("reason") ? ReadReason(reader) : "";
}

// Ends the reading of a body that asks for a change of `team`.
absl::Status Finish(ConfigReader& reader, const std::string& team) {
  RETURN_IF_ERROR(reader.Finish());
  return CheckTeam(team);
}

Json TeamToJson(const TeamRow& team) {
  return {{"team", team.name},
          {"created_at", TimeToJson(team.created_at)},
          {"banned", team.banned},
          {"merged_into", TextOrNull(team.merged_into)},
          {"other_names", team.other_names},
          {"members", team.members},
          {"submissions", team.submissions}};
}

absl::StatusOr<Json> WholeTeam(const Transaction& reader, const std::string& name) {
  ASSIGN_OR_RETURN(const TeamRow team, reader.teams.Find(name));
  Json body = TeamToJson(team);
  body["memberships"] = Json::array();
  for (const MemberRow& member : reader.teams.Members(team.name).rows) {
    body["memberships"].push_back(
        {{"person", member.person}, {"since_at", TimeToJson(member.since)}, {"who", member.who}});
  }
  body["events"] = Json::array();
  for (const TeamEventRow& event : reader.teams.Events(team.name)) {
    body["events"].push_back({{"at", TimeToJson(event.at)},
                              {"team", event.team},
                              {"event", event.event},
                              {"detail", TextOrNull(event.detail)},
                              {"who", event.who},
                              {"reason", TextOrNull(event.why)}});
  }
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

// Where a team has budgets: on a track, or in a phase of one.
struct BudgetPlace {
  std::string track;
  std::string phase;  // "": on the track itself
  QuotaLimits limits;

  const char* list() const { return phase.empty() ? "tracks" : "phases"; }
};

std::vector<BudgetPlace> BudgetPlaces(const ApiContext& context) {
  const auto& quota = context.config.quota;
  std::vector<BudgetPlace> places;
  for (const auto& [track, offer] : context.tracks.entries()) {
    places.push_back({track, "", quota.of(track).quota});
  }
  for (const PhasePtr& phase : context.phases.entries()) {
    const PhaseConfig& config = phase->config;
    const AdmissionRules rules = PhaseRules(config, quota.of(config.track));
    places.push_back({config.track, config.name, rules.quota});
  }
  return places;
}

using UseOf = const BudgetUse& (QuotaUse::*)(Budget) const;

// All budgets of a place, of which `to_json` makes what is used of a limit today, and in total.
Json BudgetsToJson(const BudgetPlace& place,
                   const std::function<Json(UseOf use_of, Budget budget, int64_t limit)>& to_json) {
  Json json = {{"track", place.track}};
  if (!place.phase.empty()) json["phase"] = place.phase;
  for (const Budget budget : kBudgets) {
    if (!place.phase.empty() && budget == Budget::kPractice) continue;  // it belongs to the track
    const Allowance& limit = place.limits.of(budget);
    json[std::string(EnumName(budget))] = {
        {"per_day", to_json(&QuotaUse::today_of, budget, limit.per_day)},
        {"total", to_json(&QuotaUse::total_of, budget, limit.total)}};
  }
  return json;
}

ApiResult ListTeams(const ApiContext& context, const Transaction& reader, const Request& request) {
  ASSIGN_OR_RETURN(const Page page, ReadPage(request));
  const int64_t now = absl::ToUnixMillis(context.clock.Now());
  std::map<std::string, int64_t> tokens;  // that are good today
  for (const TokenRow& token : reader.callers.Tokens().rows) {
    const bool good = token.revoked_at == 0 && (token.expires_at == 0 || token.expires_at > now);
    if (good && !token.team.empty()) ++tokens[token.team];
  }
  return PageAnswer(request, page, "teams", reader.teams.List(page.before, page.limit),
                    [&](const TeamRow& team) {
                      Json json = TeamToJson(team);
                      json["tokens"] = tokens[team.name];
                      return json;
                    });
}

ApiResult GetTeam(const ApiContext&, const Transaction& reader, const Request& request) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  RETURN_IF_ERROR(CheckTeam(TeamIn(request)));
  RETURN_IF_ERROR(RequireTeam(reader, TeamIn(request)));
  ASSIGN_OR_RETURN(Json body, WholeTeam(reader, TeamIn(request)));
  return ApiAnswer{200, std::move(body)};
}

// Does it, and answers with the team as it is afterwards. `change` returns whether it changed
// anything.
ApiResult ChangeTeam(const ApiContext& context, const std::string& team,
                     std::function<absl::StatusOr<bool>(Transaction&)> change, int http = 200) {
  const absl::StatusOr<bool> changed =
      context.engine.ChangeTeams(std::move(change), context.config.http.request);
  if (!changed.ok()) return ToTeamError(changed.status(), team);
  absl::StatusOr<Json> body = ReadStore(
      context, [&](const Transaction& reader) { return WholeTeam(reader, team); });
  if (!body.ok()) return ToTeamError(body.status(), team);
  (*body)["changed"] = *changed;
  return ApiAnswer{http, *std::move(body)};
}

ApiResult CreateTeam(const ApiContext& context, const Request&, const Json& body) {
  ConfigReader reader(body, "request");
  const std::string team = reader.String("team");
  const std::string why = ReasonOf(reader);
  RETURN_IF_ERROR(Finish(reader, team));
  NoteAct(absl::StrCat("team ", team), "created");
  return ChangeTeam(
      context, team,
      [team, why, who = CallerKey()](Transaction& writer) -> absl::StatusOr<bool> {
        RETURN_IF_ERROR(writer.teams.Create(team, who, why));
        return true;
      },
      201);
}

ApiResult RenameTeam(const ApiContext& context, const Request& request, const Json& body) {
  ConfigReader reader(body, "request");
  const std::string name = reader.String("name");
  const std::string why = ReasonOf(reader);
  const std::string team = TeamIn(request);
  RETURN_IF_ERROR(Finish(reader, team));
  NoteAct(absl::StrCat("team ", team), absl::StrCat("renamed to ", name));
  return ChangeTeam(context, team, [=, who = CallerKey()](Transaction& writer) {
    return writer.teams.Rename(team, name, who, why);
  });
}

ApiResult SetTeamMember(const ApiContext& context, const Request& request, const Json& body) {
  ConfigReader reader(body, "request");
  const std::string text = reader.String("person");
  const bool belongs = reader.Boolean("belongs");
  const std::string team = TeamIn(request);
  RETURN_IF_ERROR(Finish(reader, team));
  ASSIGN_OR_RETURN(const std::string person, PersonNamed(text));
  NoteAct(absl::StrCat("team ", team),
          absl::StrCat(person, belongs ? " is a member" : " is no longer a member"));
  return ChangeTeam(context, team, [=, person = person, who = CallerKey()](Transaction& writer) {
    return writer.teams.SetMember(team, person, belongs, who);
  });
}

ApiResult BanTeam(const ApiContext& context, const Request& request, const Json& body) {
  ConfigReader reader(body, "request");
  const bool banned = reader.Boolean("banned");
  const std::string why = ReasonOf(reader, /*required=*/banned);
  const std::string team = TeamIn(request);
  RETURN_IF_ERROR(Finish(reader, team));
  NoteAct(absl::StrCat("team ", team),
          absl::StrCat(banned ? "banned" : "no longer banned", why.empty() ? "" : ": ", why));
  return ChangeTeam(context, team, [=, who = CallerKey()](Transaction& writer) {
    return writer.teams.Ban(team, banned, who, why);
  });
}

// What the two teams have used, and what one team of both would have used.
absl::StatusOr<Json> ConsequencesOfMerge(const Transaction& reader, const ApiContext& context,
                                         const std::string& team, const std::string& into) {
  RETURN_IF_ERROR(reader.teams.CheckMerge(team, into));
  ASSIGN_OR_RETURN(const TeamRow row, reader.teams.Find(team));
  ASSIGN_OR_RETURN(const TeamRow into_row, reader.teams.Find(into));
  const std::string& from = row.name;
  const std::string& to = into_row.name;
  std::set<std::string> members(row.members.begin(), row.members.end());
  members.insert(into_row.members.begin(), into_row.members.end());
  const std::vector<TokenRow> tokens = reader.callers.Tokens().rows;
  const auto tokens_of_team = std::count_if(
      tokens.begin(), tokens.end(),
      [&](const TokenRow& token) { return token.team == from && token.revoked_at == 0; });
  Json body = {{"team", from},
               {"into", to},
               {"submissions_of_team", row.submissions},
               {"submissions", row.submissions + into_row.submissions},
               {"tokens_of_team", tokens_of_team},
               {"members", members},
               {"tracks", Json::array()},
               {"phases", Json::array()}};
  const int64_t now = absl::ToUnixMillis(context.clock.Now());
  for (const BudgetPlace& place : BudgetPlaces(context)) {
    const QuotaUse used = reader.quotas.CountQuotaUse(from, place.track, now, place.phase);
    const QuotaUse used_by_into = reader.quotas.CountQuotaUse(to, place.track, now, place.phase);
    body[place.list()].push_back(
        BudgetsToJson(place, [&](UseOf use_of, Budget budget, int64_t limit) {
          return SumToJson((used.*use_of)(budget), (used_by_into.*use_of)(budget), limit);
        }));
  }
  return body;
}

ApiResult MergeTeams(const ApiContext& context, const Request& request, const Json& body) {
  ConfigReader reader(body, "request");
  const std::string into = reader.String("into");
  const bool dry_run = reader.Has("dry_run") && reader.Boolean("dry_run");
  const std::string why = ReasonOf(reader);
  const std::string team = TeamIn(request);
  RETURN_IF_ERROR(Finish(reader, team));
  RETURN_IF_ERROR(CheckTeam(into));
  ASSIGN_OR_RETURN(Json answer, ReadStore(context, [&](const Transaction& store) {
    return ConsequencesOfMerge(store, context, team, into);
  }));
  if (!dry_run) {
    const auto merge = [=, who = CallerKey()](Transaction& writer) -> absl::StatusOr<bool> {
      RETURN_IF_ERROR(writer.teams.Merge(team, into, who, why));
      return true;
    };
    RETURN_IF_ERROR(context.engine.ChangeTeams(merge, context.config.http.request).status());
  }
  answer["merged"] = !dry_run;
  NoteAct(absl::StrCat("team ", team),
          absl::StrCat(dry_run ? "to be merged into " : "merged into ", into));
  return ApiAnswer{200, std::move(answer)};
}

// --- quota ---

Json LedgerToJson(const LedgerRow& row) {
  return {{"id", row.id},
          {"at", TimeToJson(row.at)},
          {"day", DayName(row.day)},
          {"track", row.track},
          {"phase", TextOrNull(row.phase)},
          {"budget", row.budget},
          {"entry", row.entry},
          {"amount", row.amount},
          {"submission", IdOrNull(row.submission)},
          {"who", row.who},
          {"why", row.why}};
}

void AddLedger(const Transaction& reader, const ApiContext& context,
               const Listed<LedgerRow>& ledger, Json& body) {
  body["ledger"] = Json::array();
  for (const LedgerRow& row : ledger.rows) {
    body["ledger"].push_back(LedgerToJson(row));
    RedactLedgerRow(body["ledger"].back(), FindPhaseVisibility(reader, context, row.phase));
  }
}

// `track` "": on every one.
Json QuotaOf(const Transaction& reader, const ApiContext& context, const std::string& team,
             const std::string& track) {
  const int64_t now = absl::ToUnixMillis(context.clock.Now());
  const int64_t day = reader.quotas.DayAt(now);
  Json json = {{"team", team},
               {"day", DayName(day)},
               {"next_day_at", DayName(day + 1) + "T00:00:00.000Z"},
               {"tracks", Json::array()},
               {"phases", Json::array()}};
  for (const BudgetPlace& place : BudgetPlaces(context)) {
    if (!track.empty() && track != place.track) continue;
    const QuotaUse used = reader.quotas.CountQuotaUse(team, place.track, now, place.phase);
    Json entry = BudgetsToJson(place, [&](UseOf use_of, Budget budget, int64_t limit) -> Json {
      const BudgetUse& use = (used.*use_of)(budget);
      return {{"limit", limit},
              {"granted", use.granted},
              {"used", use.charged},
              {"open", use.open},
              {"left", std::max<int64_t>(use.left(limit), 0)}};
    });
    entry["waiting"] = {{"limit", place.limits.waiting}, {"used", used.waiting}};
    json[place.list()].push_back(std::move(entry));
  }
  return json;
}

// Whether there is what a grant is for.
absl::Status CheckPlace(const NewGrant& grant, const ApiContext& context) {
  RETURN_IF_ERROR(context.tracks.Find(grant.track, "").status());
  if (grant.phase.empty()) return absl::OkStatus();
  ASSIGN_OR_RETURN(const PhasePtr phase, context.phases.Find(grant.phase));
  if (phase->config.track != grant.track) {
    return absl::InvalidArgumentError(absl::StrCat("request: phase \"", grant.phase,
                                                   "\" is of track \"", phase->config.track, "\""));
  }
  if (grant.budget == Budget::kPractice) {
    return absl::InvalidArgumentError(
        "request: practice is granted by track; leave \"phase\" out");
  }
  return absl::OkStatus();
}

ApiResult GetQuota(const ApiContext& context, const Transaction& reader, const Request& request) {
  ASSIGN_OR_RETURN(const Page page, ReadPage(request, {"team", "track"}));
  if (!request.HasParam("team")) {
    return absl::InvalidArgumentError("\"team\" is missing: quotas belong to teams");
  }
  const std::string asked = request.Param("team");
  const std::string track = request.Param("track");
  RETURN_IF_ERROR(CheckTeam(asked));
  RETURN_IF_ERROR(track.empty() ? absl::OkStatus() : context.tracks.Find(track, "").status());
  RETURN_IF_ERROR(RequireTeam(reader, asked));
  const std::string team = reader.teams.NameOf(asked);
  ApiAnswer answer{.body = QuotaOf(reader, context, team, track)};
  const Listed<LedgerRow> ledger = reader.quotas.Ledger(team, track, page.before, page.limit);
  AddNextPage(request, page, ledger, answer);
  AddLedger(reader, context, ledger, answer.body);
  return answer;
}

ApiResult GrantQuota(const ApiContext& context, const Request&, const Json& body) {
  ASSIGN_OR_RETURN(NewGrant grant, ParseGrant(body));
  RETURN_IF_ERROR(CheckPlace(grant, context));
  absl::Status status =
      context.engine.Change([row = grant, who = CallerKey()](
                                Transaction& writer) { return writer.quotas.Grant(row, who); },
                            context.config.http.request);
  ApiAnswer answer{201};
  if (status.ok()) {
    status = context.readers.Read([&](const Transaction& reader) {
      grant.team = reader.teams.NameOf(grant.team);
      answer.body = QuotaOf(reader, context, grant.team, grant.track);
      AddLedger(reader, context, reader.quotas.Ledger(grant.team, grant.track, INT64_MAX, 1),
                answer.body);
      return absl::OkStatus();
    });
  }
  if (!status.ok()) return ToTeamError(status, grant.team);
  NoteAct(absl::StrCat("team ", grant.team),
          absl::StrCat(grant.amount, " more of ", std::string(EnumName(grant.budget)), " on ",
                       grant.track, ": ", grant.why));
  return answer;
}

}  // namespace

void AddTeams(Routes& routes, const ApiContext& context) {
  const std::string team = kTeam;
  routes.Get("/v1/teams", Action::kManageTeams, Bind(context, ListTeams));
  routes.Post("/v1/teams", Action::kManageTeams, Bind(context, CreateTeam));
  routes.Get(team, Action::kReadTeam, Bind(context, GetTeam));
  routes.Post(team + "/rename", Action::kManageTeams, Bind(context, RenameTeam));
  routes.Post(team + "/members", Action::kManageTeams, Bind(context, SetTeamMember));
  routes.Post(team + "/merge", Action::kManageTeams, Bind(context, MergeTeams));
  routes.Post(team + "/ban", Action::kManageTeams, Bind(context, BanTeam));
  routes.Get("/v1/quota", Action::kReadQuota, Bind(context, GetQuota));
  routes.Post("/v1/quota/grants", Action::kGrant, Bind(context, GrantQuota));
}

}  // namespace myograde::server
