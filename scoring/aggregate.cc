#include "scoring/aggregate.h"

#include <algorithm>
#include <cmath>

#include <absl/strings/str_cat.h>

namespace myograde::scoring {
namespace {

// The 97.5 % quantile of the normal distribution: half a 95 % interval in standard errors.
constexpr double kHalfWidth = 1.959963984540054;

Mean MeanOf(const std::vector<double>& values) {
  Mean mean;
  mean.count = static_cast<int64_t>(values.size());
  if (values.empty()) return mean;
  const double n = static_cast<double>(values.size());
  double sum = 0;
  for (const double value : values) sum += value;
  mean.value = sum / n;
  double squares = 0;
  for (const double value : values) squares += (value - mean.value) * (value - mean.value);
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
  spread.low = std::max(0.0, centre - half);
  spread.high = std::min(1.0, centre + half);
  return spread;
}

bool HasResult(const JudgedEpisode& episode) {
  return episode.judgement.outcome != Outcome::kCancelled &&
         episode.judgement.outcome != Outcome::kGraderError;
}

// The mean of what `metric` returns (a double or an optional of one) over the episodes.
template <typename Metric>
Mean MeanOver(const std::vector<JudgedEpisode>& episodes, Metric metric) {
  std::vector<double> values;
  for (const JudgedEpisode& episode : episodes) {
    const std::optional<double> value = metric(episode.judgement.metrics);
    if (value.has_value()) values.push_back(*value);
  }
  return MeanOf(values);
}

// The sum of one metric over all episodes by the steps of all; nullopt without a step.
std::optional<double> OverSteps(const std::vector<JudgedEpisode>& episodes,
                                double Metrics::* sum_of) {
  double sum = 0;
  int64_t steps = 0;
  for (const JudgedEpisode& episode : episodes) {
    sum += episode.judgement.metrics.*sum_of;
    steps += episode.judgement.metrics.steps;
  }
  if (steps == 0) return std::nullopt;
  return sum / static_cast<double>(steps);
}

absl::Status CheckIndices(const std::vector<JudgedEpisode>& sorted) {
  for (size_t i = 0; i < sorted.size(); ++i) {
    if (sorted[i].index < 0) {
      return absl::InvalidArgumentError(
          absl::StrCat("an episode has the index ", sorted[i].index, "; indices start at 0"));
    }
    if (i > 0 && sorted[i].index == sorted[i - 1].index) {
      return absl::InvalidArgumentError(absl::StrCat(
          "episode ", sorted[i].index, " is there twice; each episode counts once"));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Aggregate> AggregateEpisodes(std::vector<JudgedEpisode> episodes) {
  std::sort(episodes.begin(), episodes.end(),
            [](const auto& a, const auto& b) { return a.index < b.index; });
  if (absl::Status status = CheckIndices(episodes); !status.ok()) return status;
  std::erase_if(episodes, [](const JudgedEpisode& episode) { return !HasResult(episode); });

  Aggregate result;
  result.episodes = static_cast<int64_t>(episodes.size());
  for (const JudgedEpisode& episode : episodes) {
    const Outcome outcome = episode.judgement.outcome;
    if (outcome == Outcome::kSuccess) ++result.successes;
    if (FaultOf(outcome) == Fault::kParticipant) ++result.participant_faults;
  }
  result.failed = result.participant_faults == result.episodes;
  result.success_spread = SuccessSpread(result.successes, result.episodes);
  result.time = MeanOver(episodes, [](const Metrics& m) { return m.time; });
  result.effort = MeanOver(episodes, [](const Metrics& m) { return m.effort; });
  result.pain = MeanOver(episodes, [](const Metrics& m) { return m.pain; });
  result.distance = MeanOver(episodes, [](const Metrics& m) { return m.distance; });
  result.effort_sum = MeanOver(episodes, [](const Metrics& m) { return m.effort_sum; });
  result.pain_sum = MeanOver(episodes, [](const Metrics& m) { return m.pain_sum; });
  result.reported_time = MeanOver(episodes, [](const Metrics& m) { return m.reported_time; });
  result.peak_force = MeanOver(episodes, [](const Metrics& m) { return m.peak_force; });
  result.max_touch = MeanOver(episodes, [](const Metrics& m) { return m.max_touch; });
  result.effort_over_steps = OverSteps(episodes, &Metrics::effort_sum);
  result.pain_over_steps = OverSteps(episodes, &Metrics::pain_sum);
  return result;
}

}  // namespace myograde::scoring
