#include "server/grading/highlights.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "scoring/groups.h"
#include "server/grading/results.h"

namespace myograde::server {
namespace {

using scoring::Better;
using scoring::Criterion;
using scoring::Judgement;
using scoring::Metric;

// Numbers of which less is better, in the order in which they decide.
using SortKey = std::vector<double>;

double Failed(const Judgement& judgement) {
  return judgement.outcome == Outcome::kSuccess ? 0 : 1;
}

// A metric that the episode lacks is behind all numbers.
double NumberOf(const scoring::ScoredTrack& track, size_t number, const Judgement& judgement) {
  const Metric& metric = scoring::MetricOf(track.metrics, number);
  const auto place = static_cast<size_t>(&metric - track.metrics.data());
  if (place >= judgement.metrics.size() || !judgement.metrics[place].has_value()) {
    return std::numeric_limits<double>::infinity();
  }
  return metric.better == Better::kMore ? -*judgement.metrics[place] : *judgement.metrics[place];
}

SortKey KeyOf(const scoring::ScoredTrack& track, const std::vector<Criterion>& criteria,
              const Judgement& judgement, int64_t index) {
  SortKey key;
  for (const Criterion& criterion : criteria) {
    key.push_back(criterion.kind == Criterion::Kind::kNumber
                      ? NumberOf(track, criterion.number, judgement)
                      : Failed(judgement));
  }
  key.push_back(Failed(judgement));
  key.push_back(static_cast<double>(index));
  return key;
}

bool HasLog(const EpisodeRow& row) {
  const auto facts = nlohmann::json::parse(row.facts_json, nullptr, /*allow_exceptions=*/false);
  return facts.is_object() && facts.contains("log") && facts["log"].is_object();
}

}  // namespace

absl::StatusOr<std::optional<Highlights>> HighlightsOf(const scoring::TrackScoring& scoring,
                                                       const std::vector<EpisodeRow>& rows) {
  const std::vector<Criterion> criteria =
      scoring::CriteriaOf(scoring.boards.at(scoring::kMainBoard).rules);
  std::vector<std::pair<SortKey, size_t>> order;
  for (size_t i = 0; i < rows.size(); ++i) {
    if (!HasLog(rows[i])) continue;
    const absl::StatusOr<Judgement> judgement = JudgementOf(*scoring.track, rows[i]);
    if (!judgement.ok()) return judgement.status();
    order.emplace_back(KeyOf(*scoring.track, criteria, *judgement, rows[i].index), i);
  }
  if (order.empty()) return std::nullopt;
  std::sort(order.begin(), order.end());
  return Highlights{.best = order.front().second,
                    .median = order[(order.size() - 1) / 2].second,
                    .worst = order.back().second};
}

}  // namespace myograde::server
