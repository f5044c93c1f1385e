#include "server/api/views.h"

#include <unistd.h>

#include <map>

#include "protocol/lease/seed_commitment.h"
#include "server/store/differences.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

Json Parse(const std::string& text) {
  Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  return json.is_discarded() ? Json() : json;
}

Json KeyOrNull(const Json& object, const char* key) {
  return object.is_object() && object.contains(key) ? object[key] : Json();
}

Json SideToJson(const EpisodeRow& row) {
  const Json facts = Parse(row.facts_json);
  return {{"outcome", OutcomeName(row.outcome)},
          {"reason", row.reason.name()},
          {"steps", KeyOrNull(facts, "steps")},
          {"digest", KeyOrNull(facts, "digest")},
          {"metrics", Parse(row.metrics_json)}};
}

}  // namespace

nlohmann::json TimeToJson(int64_t ms) {
  if (ms == 0) return nullptr;
  return absl::FormatTime("%Y-%m-%dT%H:%M:%E3SZ", absl::FromUnixMillis(ms), absl::UTCTimeZone());
}

nlohmann::json DamagedToJson(const std::vector<Damage>& damaged) {
  Json list = Json::array();
  for (const Damage& damage : damaged) {
    list.push_back({{"table", damage.table},
                    {"key", damage.key},
                    {"message", DamageText(damage)}});
  }
  return list;
}

nlohmann::json IdOrNull(int64_t id) {
  return id == 0 ? nlohmann::json() : nlohmann::json(id);
}

nlohmann::json TextOrNull(const std::string& text) { return text.empty() ? Json() : Json(text); }

nlohmann::json SecondsOrNull(const std::optional<absl::Duration>& duration) {
  return duration ? Json(absl::ToDoubleSeconds(*duration)) : Json();
}

nlohmann::json CountsToJson(int64_t total, const EpisodeCounts& counts) {
  return {{"total", total},
          {"done", counts.done},
          {"success", counts.success},
          {"failure", counts.failure},
          {"fault", counts.fault}};
}

nlohmann::json EpisodeToJson(const EpisodeRow& row, const std::string& seed_salt) {
  const Json facts = Parse(row.facts_json);
  const Json track = KeyOrNull(facts, "track");
  Json json = {
          {"index", row.index},
          {"seed", row.seed},
          {"outcome", OutcomeName(row.outcome)},
          {"reason", row.reason.name()},
          {"metrics", Parse(row.metrics_json)},
          {"steps", KeyOrNull(facts, "steps")},
          {"sim_time_s", KeyOrNull(facts, "sim_time")},
          {"clipped", KeyOrNull(facts, "clipped")},
          {"digest", KeyOrNull(facts, "digest")},
          {"actions_digest", KeyOrNull(facts, "actions_digest")},
          {"log", KeyOrNull(facts, "log")},
          {"end", KeyOrNull(facts, "end")},
          {"fault", KeyOrNull(facts, "fault")},
          {"facts", KeyOrNull(facts, track.is_string() ? track.get<std::string>().c_str() : "")},
          {"details", Parse(row.details_json)},
          {"wall_s", KeyOrNull(facts, "wall_s")},
          {"policy_cpu_s", KeyOrNull(facts, "policy_cpu_s")},
          {"attempt", row.attempt}};
  if (!seed_salt.empty()) {
    json["seed_commitment"] = SeedCommitment(seed_salt, row.index, row.seed);
  }
  return json;
}

nlohmann::json MarksToJson(const std::vector<MarkRow>& rows) {
  Json list = Json::array();
  for (const MarkRow& row : rows) {
    list.push_back({{"mark", row.mark},
                    {"set", row.set},
                    {"at", TimeToJson(row.at)},
                    {"who", row.who},
                    {"reason", TextOrNull(row.why)}});
  }
  return list;
}

nlohmann::json LimitsToJson(const TrackConfig& config) {
  return KeyOrNull(config.effective, "budgets");
}

nlohmann::json CompareRows(int64_t original, const std::vector<EpisodeRow>& original_rows,
                           const EvaluationRow& rerun, const std::vector<EpisodeRow>& rerun_rows) {
  std::map<int64_t, const EpisodeRow*> theirs;
  for (const EpisodeRow& row : original_rows) theirs[row.index] = &row;
  Json episodes = Json::array();
  int64_t compared = 0;
  int64_t equal = 0;
  for (const EpisodeRow& row : rerun_rows) {
    const auto it = theirs.find(row.index);
    if (it == theirs.end()) continue;
    const std::vector<std::string> differs = DifferencesBetween(*it->second, row);
    Json entry = {{"index", row.index}, {"equal", differs.empty()}, {"differs", differs}};
    if (!differs.empty()) {
      entry["original"] = SideToJson(*it->second);
      entry["rerun"] = SideToJson(row);
    }
    ++compared;
    equal += differs.empty() ? 1 : 0;
    episodes.push_back(std::move(entry));
  }
  return {{"with", original},
          {"compared", compared},
          {"equal", equal},
          {"missing", rerun.last - rerun.first + 1 - compared},
          {"episodes", std::move(episodes)}};
}

}  // namespace myograde::server
