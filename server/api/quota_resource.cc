#include "server/api/resources.h"

#include <algorithm>
#include <functional>
#include <string>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/status_macros.h"
#include "server/api/paging.h"
#include "server/api/phase_sight.h"
#include "server/api/redaction.h"
#include "server/api/requests.h"
#include "server/api/views.h"
#include "server/store/quota.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

Json UseToJson(const BudgetUse& use, int64_t limit) {
  return {{"limit", limit},
          {"granted", use.granted},
          {"used", use.charged},
          {"open", use.open},
          {"left", std::max<int64_t>(use.left(limit), 0)}};
}

Json LedgerToJson(const LedgerRow& row) {
  return {{"id", row.id},
          {"at", TimeToJson(row.at)},
          {"day", DayName(row.day)},
          {"track", row.track},
          {"phase", TextOrNull(row.phase)},
          {"budget", row.budget},
          {"entry", row.entry},
          {"amount", row.amount},
          {"submission", row.submission == 0 ? Json() : Json(row.submission)},
          {"who", row.who},
          {"why", row.why}};
}

absl::Status AddLedger(Reader& reader, const ApiContext& context,
                       const Listed<LedgerRow>& ledger, Json& body) {
  body["ledger"] = Json::array();
  for (const LedgerRow& row : ledger.rows) {
    ASSIGN_OR_RETURN(const Visibility sight, SightOfPhase(reader, context, row.phase));
    body["ledger"].push_back(LedgerToJson(row));
    RedactLedgerRow(body["ledger"].back(), sight);
  }
  body["unreadable"] = DamagedToJson(ledger.damaged);
  return absl::OkStatus();
}

std::string BudgetText(Budget budget) { return std::string(BudgetName(budget)); }
Json EntryToJson(const std::string& track, const QuotaLimits& limits, const QuotaUse& use) {
  Json entry = {{"track", track},
                {"waiting", {{"limit", limits.waiting}, {"used", use.waiting}}}};
  for (const Budget budget : kBudgets) {
    entry[std::string(BudgetName(budget))] = {
        {"per_day", UseToJson(use.today_of(budget), limits.of(budget).per_day)},
        {"total", UseToJson(use.total_of(budget), limits.of(budget).total)}};
  }
  return entry;
}

// Practice belongs to the track.
Json PhaseEntryToJson(const PhaseConfig& phase, const QuotaLimits& limits, const QuotaUse& use) {
  Json entry = EntryToJson(phase.track, limits, use);
  entry.erase(std::string(BudgetName(Budget::kPractice)));
  entry["phase"] = phase.name;
  return entry;
}

// `track` "": on every one.
Json QuotaOf(Reader& reader, const ApiContext& context, const std::string& team,
             const std::string& track) {
  const int64_t now = absl::ToUnixMillis(context.clock.Now());
  const int64_t day = reader.QuotaDayAt(now);
  Json json = {{"team", team},
               {"day", DayName(day)},
               {"next_day_at", DayName(day + 1) + "T00:00:00.000Z"},
               {"tracks", Json::array()},
               {"phases", Json::array()}};
  for (const auto& [name, offer] : context.tracks.entries()) {
    if (!track.empty() && track != name) continue;
    const QuotaLimits& limits = context.config.quota.of(name).quota;
    json["tracks"].push_back(EntryToJson(name, limits, reader.Quota(team, name, now)));
  }
  for (const PhasePtr& phase : context.phases.entries()) {
    const PhaseConfig& config = phase->config;
    if (!track.empty() && track != config.track) continue;
    const AdmissionRules rules = PhaseRules(config, context.config.quota.of(config.track));
    json["phases"].push_back(PhaseEntryToJson(
        config, rules.quota, reader.Quota(team, config.track, now, config.name)));
  }
  return json;
}

// Whether there is what a grant is for.
absl::Status CheckPlace(const NewGrant& grant, const ApiContext& context) {
  absl::Status status = context.tracks.Find(grant.track, "").status();
  if (!status.ok() || grant.phase.empty()) return status;
  const absl::StatusOr<PhasePtr> phase = context.phases.Find(grant.phase);
  if (!phase.ok()) return phase.status();
  if ((*phase)->config.track != grant.track) {
    return absl::InvalidArgumentError(absl::StrCat("request: phase \"", grant.phase,
                                                   "\" is of track \"", (*phase)->config.track,
                                                   "\""));
  }
  if (grant.budget == Budget::kPractice) {
    return absl::InvalidArgumentError(
        "request: practice belongs to the track; leave \"phase\" out to grant it");
  }
  return status;
}

ApiResult GetQuota(const ApiContext& context, const Request& request) {
  absl::Status status = CheckParameters(request, {"team", "track", "before", "limit"});
  if (status.ok() && !request.HasParam("team")) {
    status = absl::InvalidArgumentError("\"team\" is missing: a quota is a team's");
  }
  const std::string asked = request.Param("team");
  const std::string track = request.Param("track");
  if (status.ok()) status = CheckTeam(asked);
  const absl::StatusOr<Page> page = ReadPage(request);
  status.Update(page.status());
  RETURN_IF_ERROR(status);
  if (!track.empty()) status = context.tracks.Find(track, "").status();
  RETURN_IF_ERROR(status);
  ApiAnswer answer;
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) -> absl::Status {
    RETURN_IF_ERROR(RequireTeam(reader, asked));
    const std::string team = reader.TeamOf(asked);
    answer.body = QuotaOf(reader, context, team, track);
    const Listed<LedgerRow> ledger = reader.Ledger(team, track, page->before, page->limit);
    AddNextPage(request, *page, ledger, answer);
    return AddLedger(reader, context, ledger, answer.body);
  }));
  return answer;
}

ApiResult GrantQuota(const ApiContext& context, const Request&, const Json& body) {
  ASSIGN_OR_RETURN(NewGrant grant, ParseGrant(body));
  RETURN_IF_ERROR(CheckPlace(grant, context));
  absl::Status status = context.engine.Change(
      [row = grant, who = CallerKey()](Writer& writer) { return writer.Grant(row, who); },
      context.config.http.request);
  ApiAnswer answer{201};
  if (status.ok()) {
    status = context.readers.Read([&](Reader& reader) {
      grant.team = reader.TeamOf(grant.team);
      answer.body = QuotaOf(reader, context, grant.team, grant.track);
      return AddLedger(reader, context,
                       reader.Ledger(grant.team, grant.track, INT64_MAX, 1), answer.body);
    });
  }
  if (!status.ok()) return TeamErrorOf(status, grant.team);
  NoteAct(absl::StrCat("team ", grant.team),
          absl::StrCat(grant.amount, " more of ", BudgetText(grant.budget), " on ", grant.track,
                       ": ", grant.why));
  return answer;
}

}  // namespace

void AddQuota(Routes& routes, const ApiContext& context) {
  routes.Get("/v1/quota", Action::kReadQuota, std::bind_front(GetQuota, std::cref(context)));
  routes.Post("/v1/quota/grants", Action::kGrant, std::bind_front(GrantQuota, std::cref(context)));
}

}  // namespace myograde::server
