#include "server/api/views.h"

#include <algorithm>
#include <map>

#include <absl/strings/str_cat.h>

#include "protocol/lease/seed_commitment.h"
#include "server/base/http_client.h"
#include "server/store/episodes.h"

namespace myograde::server {
namespace {

Json Parse(const std::string& text) {
  Json json = ParsedText(text);
  return json.is_discarded() ? Json() : json;
}

Json SideToJson(const EpisodeRow& row) {
  const Json facts = Parse(row.facts_json);
  return {{"outcome", OutcomeName(row.outcome)},
          {"reason", row.reason.name()},
          {"steps", At(facts, "steps")},
          {"digest", At(facts, "digest")},
          {"metrics", Parse(row.metrics_json)}};
}

// The rest at the pace so far; null without a pace.
Json Remaining(const EvaluationRow& evaluation, const EpisodeCounts& counts, int64_t now_ms) {
  if (evaluation.state != EvaluationState::kRunning || counts.done == 0) return nullptr;
  const double elapsed = static_cast<double>(now_ms - evaluation.started_at) / 1000;
  const auto left = static_cast<double>(evaluation.last - evaluation.first + 1 - counts.done);
  return std::max(elapsed, 0.0) * left / static_cast<double>(counts.done);
}

}  // namespace

Json TimeToJson(int64_t ms) {
  if (ms == 0) return nullptr;
  return TimeText(ms);
}

Json DamagedToJson(const std::vector<Damage>& damaged) {
  Json list = Json::array();
  for (const Damage& damage : damaged) {
    list.push_back({{"table", damage.table}, {"key", damage.key}, {"message", DamageText(damage)}});
  }
  return list;
}

Json SecondsOrNull(const std::optional<absl::Duration>& duration) {
  return duration ? Json(absl::ToDoubleSeconds(*duration)) : Json();
}

Json EpisodeToJson(const EpisodeRow& row, const std::string& seed_salt) {
  const Json facts = Parse(row.facts_json);
  const Json track = At(facts, "track");
  Json json = {
      {"index", row.index},
      {"seed", row.seed},
      {"outcome", OutcomeName(row.outcome)},
      {"reason", row.reason.name()},
      {"metrics", Parse(row.metrics_json)},
      {"sim_time_s", At(facts, "sim_time")},
      {"facts", At(facts, track.is_string() ? track.get<std::string>().c_str() : "")},
      {"details", Parse(row.details_json)},
      {"attempt", row.attempt}};
  for (const char* key : {"steps", "clipped", "digest", "actions_digest", "log", "end", "fault",
                          "wall_s", "policy_cpu_s"}) {
    json[key] = At(facts, key);
  }
  if (!seed_salt.empty()) {
    json["seed_commitment"] = SeedCommitment(seed_salt, row.index, row.seed);
  }
  return json;
}

Json MarksToJson(const std::vector<MarkRow>& rows) {
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

Json CompareRows(int64_t original, const std::vector<EpisodeRow>& original_rows,
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

Json NodesToJson(const std::vector<NodeView>& known, const std::vector<DrainedNodeRow>& drained,
                 bool remote) {
  std::map<std::string, NodeView> nodes;
  for (const NodeView& node : known) nodes[node.name] = node;
  std::map<std::string, const DrainedNodeRow*> rows;
  for (const DrainedNodeRow& row : drained) {
    rows[row.node] = &row;
    if (remote) nodes.try_emplace(row.node, NodeView{row.node, "drained", row.why});
  }
  Json list = Json::array();
  for (const auto& [name, node] : nodes) {
    const auto row = rows.find(name);
    const bool is_drained = node.state == "drained" && row != rows.end();
    list.push_back({{"node", node.name},
                    {"state", node.state},
                    {"reason", TextOrNull(node.why)},
                    {"drained_at", is_drained ? TimeToJson(row->second->at) : Json()},
                    {"drained_by", is_drained ? Json(row->second->who) : Json()},
                    {"processor", TextOrNull(node.processor)},
                    {"running", node.running},
                    {"done", node.done},
                    {"faults", node.faults}});
  }
  return list;
}

Json Ahead(const std::optional<absl::Duration>& duration, absl::Time now) {
  if (!duration || *duration == absl::InfiniteDuration()) return nullptr;
  return TimeToJson(absl::ToUnixMillis(now + *duration));
}

Json SubmissionToJson(const SubmissionRow& row, const EvaluationRow& evaluation,
                      const EpisodeCounts& counts) {
  return {{"submission", row.id},
          {"team", row.team},
          {"track", row.track},
          {"profile", row.profile},
          {"phase", TextOrNull(row.phase)},
          {"artefact", row.artefact},
          {"name", row.artefact_name},
          {"ranked", row.ranked},
          {"state", EnumName(evaluation.state)},
          {"evaluation", evaluation.id},
          {"episodes",
           {{"total", evaluation.last - evaluation.first + 1},
            {"done", counts.done},
            {"success", counts.success},
            {"failure", counts.failure},
            {"fault", counts.fault}}},
          {"accepted_at", TimeToJson(row.accepted_at)},
          {"finished_at", TimeToJson(evaluation.finished_at)}};
}

QueueOutlook AddOutlook(const ApiContext& context, const EvaluationRow& evaluation,
                        const EpisodeCounts& counts, Json& json) {
  const int64_t now = absl::ToUnixMillis(context.clock.Now());
  QueueOutlook outlook = context.engine.EstimateOutlook(evaluation.id);
  json["queue"] = nullptr;
  if (outlook.place && evaluation.state == EvaluationState::kQueued) {
    json["queue"] = {{"position", outlook.place->position},
                     {"blocks_ahead", outlook.place->blocks_ahead}};
  }
  json["waiting"] = TextOrNull(outlook.waiting);
  json["started_at"] = TimeToJson(evaluation.started_at);
  const int64_t end = evaluation.finished_at == 0 ? now : evaluation.finished_at;
  json["running_wall_s"] = evaluation.started_at == 0
                               ? Json()
                               : Json(static_cast<double>(end - evaluation.started_at) / 1000);
  json["remaining_wall_s"] = Remaining(evaluation, counts, now);
  if (json["remaining_wall_s"].is_null()) json["remaining_wall_s"] = SecondsOrNull(outlook.end);
  json["estimated_end_at"] =
      json["remaining_wall_s"].is_null()
          ? Json()
          : Ahead(absl::Seconds(json["remaining_wall_s"].get<double>()), context.clock.Now());
  return outlook;
}

void AddNextPage(const Request& request, bool more, int64_t last_id, ApiAnswer& answer) {
  answer.body["next_before"] = more ? Json(last_id) : Json();
  if (!more) return;
  answer.next = absl::StrCat(request.path, "?before=", last_id);
  for (const auto& [key, value] : request.params) {
    if (key == "before") continue;
    absl::StrAppend(&answer.next, "&", QueryValue(key), "=", QueryValue(value));
  }
}

}  // namespace myograde::server
