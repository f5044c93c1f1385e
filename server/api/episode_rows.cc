#include "server/api/episode_rows.h"

#include <algorithm>
#include <array>
#include <map>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <absl/strings/str_split.h>

#include "protocol/base/status_macros.h"
#include "scoring/episode_order.h"
#include "server/api/requests.h"
#include "server/api/views.h"

namespace myograde::server {
namespace {

constexpr auto kRowKeys = std::to_array<const char*>(
    {"index", "attempt", "seed", "seed_commitment", "outcome", "reason", "end", "fault", "metrics",
     "steps", "sim_time_s", "clipped", "digest", "actions_digest", "wall_s", "policy_cpu_s", "log",
     "facts", "details"});
constexpr size_t kMaxFields = 40;

absl::Status ReadFields(const std::string& text, EpisodeSelection& selection) {
  selection.fields = absl::StrSplit(text, ',');
  if (selection.fields.size() > kMaxFields) {
    return absl::InvalidArgumentError(absl::StrCat("\"fields\" has ", selection.fields.size(),
                                                   " keys; at most ", kMaxFields, " are allowed"));
  }
  for (const std::string& field : selection.fields) {
    const std::string key = field.substr(0, field.find('.'));
    if (std::find(kRowKeys.begin(), kRowKeys.end(), key) != kRowKeys.end()) continue;
    return absl::InvalidArgumentError(absl::StrCat(
        "\"fields\" has \"", field, "\", which is not a key of an episode's row; known: ",
        absl::StrJoin(kRowKeys, ", "), "; write a key within one of them after a dot: "
                                       "facts.course"));
  }
  return absl::OkStatus();
}

// The value of "facts.course" is that at "course" of the one at "facts".
Json ValueAt(const Json& row, const std::string& field) {
  const size_t dot = field.find('.');
  const auto outer = row.find(field.substr(0, dot));
  if (outer == row.end()) return nullptr;
  if (dot == std::string::npos) return *outer;
  return outer->is_object() ? outer->value(field.substr(dot + 1), Json()) : Json();
}

// One place in the details of episodes: an object, an array, or a number that may be missing.
struct SummaryNode {
  void Add(const Json& value) {
    if (value.is_object()) {
      for (const auto& [key, part] : value.items()) keys[key].Add(part);
    } else if (value.is_array()) {
      if (items.size() < value.size()) items.resize(value.size());
      for (size_t i = 0; i < value.size(); ++i) items[i].Add(value[i]);
    } else if (value.is_number()) {
      const auto number = value.get<double>();
      low = count == 0 ? number : std::min(low, number);
      high = count == 0 ? number : std::max(high, number);
      sum += number;
      ++count;
    }
  }

  Json ToJson() const {
    Json made;
    for (const auto& [key, part] : keys) made[key] = part.ToJson();
    if (!keys.empty()) return made;
    for (const SummaryNode& item : items) made.push_back(item.ToJson());
    if (!items.empty()) return made;
    if (count == 0) return {{"count", 0}, {"min", nullptr}, {"mean", nullptr}, {"max", nullptr}};
    return {{"count", count},
            {"min", low},
            {"mean", sum / static_cast<double>(count)},
            {"max", high}};
  }

  std::map<std::string, SummaryNode> keys;
  std::vector<SummaryNode> items;
  int64_t count = 0;
  double low = 0;
  double high = 0;
  double sum = 0;
};

}  // namespace

bool EpisodeSelection::needs_details() const {
  if (summary) return true;
  if (!rows) return false;
  if (fields.empty()) return details;
  return std::any_of(fields.begin(), fields.end(), [](const std::string& field) {
    return field == "details" || field.starts_with("details.");
  });
}

absl::StatusOr<EpisodeSelection> ParseEpisodes(const Request& request) {
  RETURN_IF_ERROR(
      CheckParameters(request, {"details", "episodes", "fields", "first", "last", "summary"}));
  EpisodeSelection selection;
  ASSIGN_OR_RETURN(selection.rows, ReadSwitch(request, "episodes", false));
  ASSIGN_OR_RETURN(selection.details, ReadSwitch(request, "details", true));
  ASSIGN_OR_RETURN(selection.summary, ReadSwitch(request, "summary", false));
  constexpr int64_t kMost = std::numeric_limits<int64_t>::max();
  RETURN_IF_ERROR(ReadNumber(request, "first", kMost, selection.first, 0));
  RETURN_IF_ERROR(ReadNumber(request, "last", kMost, selection.last, 0));
  if (request.HasParam("fields")) {
    RETURN_IF_ERROR(ReadFields(request.Param("fields"), selection));
  }
  return selection;
}

Json RowsToJson(const std::vector<EpisodeRow>& rows, const std::string& seed_salt,
                const EpisodeSelection& selection) {
  Json list = Json::array();
  for (const EpisodeRow& row : rows) {
    if (row.index < selection.first || row.index > selection.last) continue;
    list.push_back(EpisodeToJson(row, seed_salt));
    if (!selection.details) list.back()["details"] = nullptr;
  }
  return list;
}

Json ColumnsOf(const std::vector<std::string>& fields, const Json& rows) {
  Json columns = {{"index", Json::array()}};
  for (const std::string& field : fields) columns[field] = Json::array();
  for (auto& [field, column] : columns.items()) {
    for (const Json& row : rows) column.push_back(ValueAt(row, field));
  }
  return columns;
}

absl::Status AddSummary(const Track& track, const std::vector<EpisodeRow>& rows,
                        const std::vector<scoring::JudgedEpisode>& judged, Json& json) {
  std::vector<std::pair<Json, int64_t>> details;
  std::vector<scoring::JudgedEpisode> logged;
  std::map<int64_t, const EpisodeRow*> by_index;
  for (size_t i = 0; i < rows.size(); ++i) {
    if (judged[i].verdict.reason.name() == scoring::kPhantom) continue;
    details.emplace_back(ParsedText(rows[i].details_json), judged[i].verdict.steps);
    const Json facts = ParsedText(rows[i].facts_json);
    if (!facts.is_object() || !facts.value("log", Json()).is_object()) continue;
    logged.push_back(judged[i]);
    by_index[rows[i].index] = &rows[i];
  }
  json["details_summary"] = SummaryOf(details);
  ASSIGN_OR_RETURN(const std::vector<int64_t> order, EpisodesInOrder(track.scoring, logged));
  Json& highlights = json["highlights"] = Json::object();
  for (const scoring::PickedEpisode& picked : scoring::BestMedianWorst(order)) {
    highlights[std::string(picked.place)] =
        EpisodeToJson(*by_index.at(picked.index), track.config.seed_salt);
  }
  return absl::OkStatus();
}

Json SummaryOf(const std::vector<std::pair<Json, int64_t>>& episodes) {
  SummaryNode values;
  int64_t count = 0;
  int64_t sum = 0;
  for (const auto& [details, steps] : episodes) {
    if (!details.is_object()) continue;
    values.Add(details);
    ++count;
    sum += steps;
  }
  if (count == 0) return nullptr;
  return {{"episodes", count}, {"steps", sum}, {"values", values.ToJson()}};
}

}  // namespace myograde::server
