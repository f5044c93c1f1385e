#include "scoring/aggregate.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string_view>

#include <Eigen/Core>
#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde::scoring {
namespace {

// The 97.5 % quantile of the normal distribution: half a 95 % interval in standard errors.
constexpr double kHalfWidth = 1.959963984540054;

Mean ComputeMean(const std::vector<double>& values) {
  Mean mean;
  mean.count = static_cast<int64_t>(values.size());
  if (values.empty()) return mean;
  const double n = static_cast<double>(values.size());
  const auto all = Eigen::ArrayXd::Map(values.data(), std::ssize(values));
  mean.value = all.sum() / n;
  const double squares = (all - mean.value).square().sum();
  if (values.size() > 1) mean.spread.deviation = std::sqrt(squares / (n - 1));
  const double half = kHalfWidth * mean.spread.deviation / std::sqrt(n);
  mean.spread.low = mean.value - half;
  mean.spread.high = mean.value + half;
  return mean;
}

// Wilson's score interval: unlike mean and standard error it stays in [0, 1] and has a width
// at 0 and n successes.
Spread SuccessSpread(int64_t successes, int64_t episodes) {
  if (episodes == 0) return {};
  const double n = static_cast<double>(episodes);
  const double p = static_cast<double>(successes) / n;
  const double z2 = kHalfWidth * kHalfWidth;
  const double centre = (p + z2 / (2 * n)) / (1 + z2 / n);
  const double half =
      kHalfWidth / (1 + z2 / n) * std::sqrt(p * (1 - p) / n + z2 / (4 * n * n));
  Spread spread;
  spread.deviation = episodes > 1 ? std::sqrt(p * (1 - p) * n / (n - 1)) : 0;
  // Exact where rounding would leave them near it.
  spread.low = successes == 0 ? 0 : std::max(0.0, centre - half);
  spread.high = successes == episodes ? 1 : std::min(1.0, centre + half);
  return spread;
}

bool HasResult(const JudgedEpisode& episode) {
  return episode.verdict.outcome != Outcome::kCancelled &&
         episode.verdict.outcome != Outcome::kGraderError;
}

std::optional<double> ValueOf(const JudgedEpisode& episode, size_t metric) {
  const auto& values = episode.verdict.metrics;
  return metric < values.size() ? values[metric] : std::nullopt;
}

Mean MeanOver(const std::vector<JudgedEpisode>& episodes, size_t metric) {
  std::vector<double> values;
  for (const JudgedEpisode& episode : episodes) {
    const std::optional<double> value = ValueOf(episode, metric);
    if (value.has_value()) values.push_back(*value);
  }
  return ComputeMean(values);
}

// The sum of one metric over all episodes by the steps of all; none without a step.
Mean MeanOverSteps(const std::vector<JudgedEpisode>& episodes, size_t summed) {
  double sum = 0;
  int64_t steps = 0;
  for (const JudgedEpisode& episode : episodes) {
    sum += ValueOf(episode, summed).value_or(0);
    steps += episode.verdict.steps;
  }
  if (steps == 0) return {};
  return {.value = sum / static_cast<double>(steps), .count = 1, .spread = {}};
}

size_t PlaceOf(std::span<const Metric> metrics, std::string_view name) {
  const auto it = std::find_if(metrics.begin(), metrics.end(),
                               [&](const Metric& metric) { return metric.name == name; });
  return static_cast<size_t>(it - metrics.begin());
}

absl::Status CheckIndices(const std::vector<JudgedEpisode>& sorted) {
  for (size_t i = 0; i < sorted.size(); ++i) {
    if (sorted[i].index < 0) {
      return absl::InvalidArgumentError(
          absl::StrCat("an episode has the index ", sorted[i].index, "; indices start at 0"));
    }
    if (i > 0 && sorted[i].index == sorted[i - 1].index) {
      return absl::InvalidArgumentError(absl::StrCat(
          "episode ", sorted[i].index, " appears twice; each episode counts once"));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Aggregate> AggregateEpisodes(std::span<const Metric> metrics,
                                            std::vector<JudgedEpisode> episodes) {
  std::sort(episodes.begin(), episodes.end(),
            [](const auto& a, const auto& b) { return a.index < b.index; });
  RETURN_IF_ERROR(CheckIndices(episodes));
  std::erase_if(episodes, [](const JudgedEpisode& episode) { return !HasResult(episode); });

  Aggregate result;
  result.episodes = static_cast<int64_t>(episodes.size());
  for (const JudgedEpisode& episode : episodes) {
    const Outcome outcome = episode.verdict.outcome;
    if (outcome == Outcome::kSuccess) ++result.successes;
    if (FaultOf(outcome) == Fault::kParticipant) ++result.participant_faults;
  }
  result.failed = result.participant_faults == result.episodes;
  result.success_spread = SuccessSpread(result.successes, result.episodes);
  for (size_t i = 0; i < metrics.size(); ++i) {
    result.means.push_back(metrics[i].source == Metric::Source::kOverSteps
                               ? MeanOverSteps(episodes, PlaceOf(metrics, metrics[i].of))
                               : MeanOver(episodes, i));
  }
  return result;
}

}  // namespace myograde::scoring
