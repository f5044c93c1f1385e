#include "scoring/aggregate_json.h"

#include <algorithm>
#include <optional>
#include <string>

namespace myograde::scoring {
namespace {

using Json = nlohmann::json;

Json SpreadToJson(const Spread& spread) {
  Json json;
  json["deviation"] = spread.deviation;
  json["low"] = spread.low;
  json["high"] = spread.high;
  return json;
}

// null if there is none, or no object.
const Json& ValueAt(const Json& json, std::string_view key) {
  static const Json kNone;
  const auto found = json.find(key);
  return found == json.end() ? kNone : *found;
}

}  // namespace

Json MetricsToJson(const ScoredTrack& track, const Verdict& verdict) {
  Json json;
  json["success"] = verdict.outcome == Outcome::kSuccess ? 1 : 0;
  for (size_t i = 0; i < track.metrics.size(); ++i) {
    const Metric& metric = track.metrics[i];
    if (metric.source != Metric::Source::kJudged) continue;
    const std::optional<double>& value = verdict.metrics.at(i);
    json[std::string(metric.name)] = value.has_value() ? Json(*value) : Json();
  }
  for (const std::string_view key : track.null_metrics) json[std::string(key)] = nullptr;
  return json;
}

Json AggregateToJson(const ScoredTrack& track, const Aggregate& aggregate) {
  if (aggregate.episodes == 0) return nullptr;
  Json json;
  json["episodes"] = aggregate.episodes;
  json["successes"] = aggregate.successes;
  json["success_rate"] = aggregate.success_rate();
  Json spread;
  spread["success_rate"] = SpreadToJson(aggregate.success_spread);
  for (size_t i = 0; i < track.metrics.size(); ++i) {
    const std::string name(track.metrics[i].name);
    const Mean& mean = aggregate.means.at(i);
    json[name] = mean.count == 0 ? Json() : Json(mean.value);
    if (track.metrics[i].spread) spread[name] = mean.count == 0 ? Json() : SpreadToJson(mean.spread);
  }
  for (const std::string_view key : track.null_means) json[std::string(key)] = nullptr;
  for (const std::string_view key : track.null_spreads) spread[std::string(key)] = nullptr;
  json["spread"] = std::move(spread);
  return json;
}

BoardEntry EntryOfJson(const ScoredTrack& track, const Json& aggregate) {
  const auto count = [&](std::string_view key) {
    const Json& value = ValueAt(aggregate, key);
    return value.is_number_integer() ? value.get<int64_t>() : 0;
  };
  BoardEntry entry;
  entry.successes = count("successes");
  entry.episodes = count("episodes");
  for (const Metric& metric : track.metrics) {
    if (!metric.ranked) continue;
    const Json& value = ValueAt(aggregate, metric.name);
    entry.numbers.push_back(value.is_number() ? std::optional(value.get<double>()) : std::nullopt);
  }
  return entry;
}

bool HasRankedNumbers(const ScoredTrack& track, const Json& aggregate) {
  return std::ranges::all_of(track.metrics, [&](const Metric& metric) {
    return !metric.ranked || aggregate.contains(metric.name);
  });
}

Json MetricToJson(const Metric& metric) {
  const char* better = metric.better == Better::kLess   ? "less"
                       : metric.better == Better::kMore ? "more"
                                                        : "neither";
  Json json;
  json["name"] = metric.name;
  json["title"] = metric.title;
  json["unit"] = metric.unit;
  json["better"] = better;
  json["digits"] = metric.digits;
  return json;
}

Json ShownMetrics(const TrackScoring& scoring) {
  Json shown = Json::array();
  for (const Metric& metric : scoring.track->metrics) {
    const bool is_shown =
        metric.shown == Metric::Shown::kAlways ||
        (metric.shown == Metric::Shown::kWithOfficialFigures && scoring.official_figures);
    if (is_shown) shown.push_back(MetricToJson(metric));
  }
  return shown;
}

}  // namespace myograde::scoring
