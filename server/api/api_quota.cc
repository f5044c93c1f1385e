// What a team may still hand in, and its ledger.
#include <absl/strings/str_cat.h>

#include "server/api/api.h"
#include "server/api/requests.h"
#include "server/api/views.h"

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

}  // namespace

absl::StatusOr<Json> Api::QuotaOf(Reader& reader, const std::string& team,
                                  const std::string& track) {
  const int64_t now = absl::ToUnixMillis(clock_.Now());
  const int64_t day = reader.QuotaDayAt(now);
  Json json = {{"team", team},
               {"day", DayName(day)},
               {"next_day_at", DayName(day + 1) + "T00:00:00.000Z"},
               {"tracks", Json::array()}};
  for (const auto& [name, offer] : tracks_.entries()) {
    if (!track.empty() && track != name) continue;
    const QuotaLimits& limits = options_.config.quota.of(name).quota;
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

Api::Result Api::GetQuota(const Request& request) {
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
  if (!track.empty() && !tracks_.entries().contains(track)) {
    return ApiError{400, "unknown_track", std::string(tracks_.Find(track, "").status().message())};
  }
  Answer answer;
  status = readers_.Read([&](Reader& reader) -> absl::Status {
    const std::string team = reader.TeamOf(asked);
    absl::StatusOr<Json> quota = QuotaOf(reader, team, track);
    if (!quota.ok()) return quota.status();
    answer.body = *std::move(quota);
    const Listed<LedgerRow> ledger = reader.Ledger(team, track, before, limit);
    AddLedger(ledger, answer.body);
    const bool more = std::ssize(ledger.rows) + std::ssize(ledger.damaged) == limit;
    answer.body["next_before"] = more ? Json(ledger.last_id) : Json();
    return absl::OkStatus();
  });
  if (!status.ok()) return ErrorOf(status);
  return answer;
}

Api::Result Api::Grant(const Request&, const Json& body) {
  if (const auto error = OnlyOrganiser()) return *error;
  absl::StatusOr<NewGrant> grant = ParseGrant(body);
  if (!grant.ok()) return ErrorOf(grant.status());
  if (!tracks_.entries().contains(grant->track)) {
    return ApiError{400, "unknown_track",
                    std::string(tracks_.Find(grant->track, "").status().message())};
  }
  absl::Status status = engine_.Change(
      [row = *grant, who = Who()](Writer& writer) { return writer.Grant(row, who); },
      options_.config.http.request);
  Answer answer{201};
  if (status.ok()) {
    status = readers_.Read([&](Reader& reader) -> absl::Status {
      grant->team = reader.TeamOf(grant->team);
      absl::StatusOr<Json> quota = QuotaOf(reader, grant->team, grant->track);
      if (!quota.ok()) return quota.status();
      answer.body = *std::move(quota);
      AddLedger(reader.Ledger(grant->team, grant->track, INT64_MAX, 1), answer.body);
      return absl::OkStatus();
    });
  }
  if (!status.ok()) return TeamErrorOf(status, grant->team);
  return answer;
}

absl::Status Api::CheckTries(const std::string& team, const std::string& track) {
  return readers_.Read([&](Reader& reader) {
    if (absl::Status status = reader.CheckTeam(team); !status.ok()) return status;
    const QuotaUse use = reader.Quota(reader.TeamOf(team), track, absl::ToUnixMillis(clock_.Now()));
    return CheckFailures(use, options_.config.quota.of(track).quota, team, track);
  });
}

}  // namespace myograde::server
