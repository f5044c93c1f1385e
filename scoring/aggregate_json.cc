#include "scoring/aggregate_json.h"

#include <algorithm>
#include <optional>
#include <string>

namespace myograde::scoring {
namespace {

using Json = nlohmann::json;

Json SpreadToJson(const Spread& spread) {
  return {{"deviation", spread.deviation}, {"low", spread.low}, {"high", spread.high}};
}

}  // namespace

Json MetricsToJson(const ScoredTrack& track, const Verdict& verdict) {
  Json json = {{"success", verdict.outcome == Outcome::kSuccess ? 1 : 0}};
  for (size_t i = 0; i < track.metrics.size(); ++i) {
    const Metric& metric = track.metrics[i];
    if (metric.source != Metric::Source::kJudged) continue;
    json[std::string(metric.name)] = verdict.metrics.at(i).has_value() ? Json(*verdict.metrics[i]) : Json();
  }
  for (const std::string_view key : track.null_metrics) json[std::string(key)] = nullptr;
  return json;
}

Json AggregateToJson(const ScoredTrack& track, const Aggregate& aggregate) {
  if (aggregate.episodes == 0) return nullptr;
  Json json = {{"episodes", aggregate.episodes},
               {"successes", aggregate.successes},
               {"success_rate", aggregate.success_rate()}};
  Json spread = {{"success_rate", SpreadToJson(aggregate.success_spread)}};
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
  const auto number = [&](std::string_view key) {
    const Json value = aggregate.is_object() ? aggregate.value(key, Json()) : Json();
    return value.is_number() ? value : Json();
  };
  const auto count = [&](const char* key) {
    const Json value = number(key);
    return value.is_number_integer() ? value.get<int64_t>() : 0;
  };
  BoardEntry entry;
  entry.successes = count("successes");
  entry.episodes = count("episodes");
  for (const Metric& metric : track.metrics) {
    if (!metric.ranked) continue;
    const Json value = number(metric.name);
    entry.numbers.push_back(value.is_null() ? std::nullopt : std::optional(value.get<double>()));
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
  return {{"name", metric.name},
          {"title", metric.title},
          {"unit", metric.unit},
          {"better", better},
          {"digits", metric.digits}};
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
