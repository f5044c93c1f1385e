#include "server/api/quota_resource.h"

#include <algorithm>
#include <functional>
#include <iterator>
#include <string>

#include <absl/strings/str_cat.h>

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
          {"budget", row.budget},
          {"entry", row.entry},
          {"amount", row.amount},
          {"submission", row.submission == 0 ? Json() : Json(row.submission)},
          {"who", row.who},
          {"why", row.why}};
}

void AddLedger(const Listed<LedgerRow>& ledger, Json& body) {
  body["ledger"] = Json::array();
  for (const LedgerRow& row : ledger.rows) body["ledger"].push_back(LedgerToJson(row));
  body["unreadable"] = DamagedToJson(ledger.damaged);
}

std::string BudgetText(Budget budget) { return std::string(BudgetName(budget)); }

// `track` "": on every one.
Json QuotaOf(Reader& reader, const ApiContext& context, const std::string& team,
             const std::string& track) {
  const int64_t now = absl::ToUnixMillis(context.clock.Now());
  const int64_t day = reader.QuotaDayAt(now);
  Json json = {{"team", team},
               {"day", DayName(day)},
               {"next_day_at", DayName(day + 1) + "T00:00:00.000Z"},
               {"tracks", Json::array()}};
  for (const auto& [name, offer] : context.tracks.entries()) {
    if (!track.empty() && track != name) continue;
    const QuotaLimits& limits = context.config.quota.of(name).quota;
    const QuotaUse use = reader.Quota(team, name, now);
    Json entry = {{"track", name},
                  {"waiting", {{"limit", limits.waiting}, {"used", use.waiting}}}};
    for (const Budget budget : kBudgets) {
      entry[std::string(BudgetName(budget))] = {
          {"per_day", UseToJson(use.today_of(budget), limits.of(budget).per_day)},
          {"total", UseToJson(use.total_of(budget), limits.of(budget).total)}};
    }
    json["tracks"].push_back(std::move(entry));
  }
  return json;
}

}  // namespace

void QuotaResource::Install(Routes& routes) {
  routes.Get("/v1/quota", Action::kReadQuota, std::bind_front(&QuotaResource::Get, this));
  routes.Post("/v1/quota/grants", Action::kGrant, std::bind_front(&QuotaResource::Grant, this));
}

ApiResult QuotaResource::Get(const httplib::Request& request) const {
  absl::Status status = CheckParameters(request, {"team", "track", "before", "limit"});
  if (status.ok() && !request.has_param("team")) {
    status = absl::InvalidArgumentError("\"team\" is missing: a quota is a team's");
  }
  const std::string asked = request.get_param_value("team");
  const std::string track = request.get_param_value("track");
  if (status.ok()) status = CheckTeam(asked);
  int64_t before = INT64_MAX;
  int64_t limit = 100;
  status.Update(ReadNumber(request, "before", INT64_MAX, before));
  status.Update(ReadNumber(request, "limit", 1000, limit));
  if (!status.ok()) return ErrorOf(status);
  if (!track.empty()) status = context_.tracks.Find(track, "").status();
  if (!status.ok()) return ErrorOf(status);
  ApiAnswer answer;
  status = context_.readers.Read([&](Reader& reader) -> absl::Status {
    if (absl::Status own = RequireTeam(reader, asked); !own.ok()) return own;
    const std::string team = reader.TeamOf(asked);
    answer.body = QuotaOf(reader, context_, team, track);
    const Listed<LedgerRow> ledger = reader.Ledger(team, track, before, limit);
    AddLedger(ledger, answer.body);
    const bool more = std::ssize(ledger.rows) + std::ssize(ledger.damaged) == limit;
    answer.body["next_before"] = more ? Json(ledger.last_id) : Json();
    return absl::OkStatus();
  });
  if (!status.ok()) return ErrorOf(status);
  return answer;
}

ApiResult QuotaResource::Grant(const httplib::Request&, const Json& body) const {
  absl::StatusOr<NewGrant> grant = ParseGrant(body);
  if (!grant.ok()) return ErrorOf(grant.status());
  absl::Status status = context_.tracks.Find(grant->track, "").status();
  if (!status.ok()) return ErrorOf(status);
  status = context_.engine.Change(
      [row = *grant, who = CallerKey()](Writer& writer) { return writer.Grant(row, who); },
      context_.config.http.request);
  ApiAnswer answer{201};
  if (status.ok()) {
    status = context_.readers.Read([&](Reader& reader) {
      grant->team = reader.TeamOf(grant->team);
      answer.body = QuotaOf(reader, context_, grant->team, grant->track);
      AddLedger(reader.Ledger(grant->team, grant->track, INT64_MAX, 1), answer.body);
      return absl::OkStatus();
    });
  }
  if (!status.ok()) return TeamErrorOf(status, grant->team);
  NoteAct(absl::StrCat("team ", grant->team),
          absl::StrCat(grant->amount, " more of ", BudgetText(grant->budget), " on ", grant->track,
                       ": ", grant->why));
  return answer;
}

}  // namespace myograde::server
