#include "scoring/aggregate.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>

namespace myograde::scoring {
namespace {

// What a track could be judged by.
constexpr Metric kMetrics[] = {
    {.name = "time_s", .title = "time", .unit = "s"},
    {.name = "effort", .title = "effort", .unit = ""},
    {.name = "pain", .title = "pain", .unit = ""},
    {.name = "effort_sum", .title = "effort sum", .unit = ""},
    {.name = "pain_sum", .title = "pain sum", .unit = ""},
    {.name = "effort_over_steps",
     .title = "effort",
     .unit = "",
     .source = Metric::Source::kOverSteps,
     .of = "effort_sum"},
    {.name = "pain_over_steps",
     .title = "pain",
     .unit = "",
     .source = Metric::Source::kOverSteps,
     .of = "pain_sum"},
};
enum Place : size_t {
  kAtTime,
  kAtEffort,
  kAtPain,
  kAtEffortSum,
  kAtPainSum,
  kAtEffortOverSteps,
  kAtPainOverSteps
};

absl::StatusOr<Aggregate> AggregateOf(std::vector<JudgedEpisode> episodes) {
  return AggregateEpisodes(kMetrics, std::move(episodes));
}

JudgedEpisode Episode(int64_t index, Outcome outcome, double time,
                      std::optional<double> effort = std::nullopt) {
  JudgedEpisode episode{.index = index, .verdict = {}};
  episode.verdict.outcome = outcome;
  episode.verdict.metrics.resize(std::size(kMetrics));
  episode.verdict.metrics[kAtTime] = time;
  episode.verdict.metrics[kAtEffort] = effort;
  return episode;
}

TEST(Aggregate, MeansLeaveOutWhatHasNoResultAndNoSteps) {
  const auto got = AggregateOf(
      {Episode(0, Outcome::kSuccess, 4, 0.2), Episode(1, Outcome::kCrash, 10),
       Episode(2, Outcome::kGraderError, 1e9, 7), Episode(3, Outcome::kCancelled, 1e9, 7)});
  ASSERT_TRUE(got.ok());
  EXPECT_EQ(got->episodes, 2);
  EXPECT_EQ(got->successes, 1);
  EXPECT_EQ(got->means[kAtTime].value, 7);
  EXPECT_EQ(got->means[kAtEffort].value, 0.2);
  EXPECT_EQ(got->means[kAtEffort].count, 1);
  EXPECT_FALSE(got->failed);
  EXPECT_NEAR(got->means[kAtTime].spread.deviation, 4.242640687119285, 1e-12);
}

// A walk of 60,000 steps and four falls: means of episodes' means would make the pain of the
// walk a fifth of what it was.
TEST(Aggregate, MeansOverStepsDoNotRewardFallingAtOnce) {
  std::vector<JudgedEpisode> episodes;
  for (int64_t i = 0; i < 5; ++i) {
    JudgedEpisode episode = Episode(i, Outcome::kFailure, 1);
    const int64_t steps = i == 0 ? 60000 : 10;
    episode.verdict.steps = steps;
    auto& metrics = episode.verdict.metrics;
    metrics[kAtPainSum] = i == 0 ? 6000 : 0;
    metrics[kAtEffortSum] = i == 0 ? 12000 : 0;
    metrics[kAtPain] = *metrics[kAtPainSum] / static_cast<double>(steps);
    episodes.push_back(episode);
  }
  const auto got = AggregateOf(episodes);
  ASSERT_TRUE(got.ok());
  EXPECT_DOUBLE_EQ(got->means[kAtPain].value, 0.02);
  EXPECT_DOUBLE_EQ(got->means[kAtPainOverSteps].value, 6000.0 / 60040);
  EXPECT_DOUBLE_EQ(got->means[kAtEffortOverSteps].value, 12000.0 / 60040);
}

TEST(Aggregate, WithoutAStepThereIsNoMeanOverSteps) {
  const auto got = AggregateOf({Episode(0, Outcome::kCrash, 10)});
  ASSERT_TRUE(got.ok());
  EXPECT_EQ(got->means[kAtEffortOverSteps].count, 0);
  EXPECT_EQ(got->means[kAtPainOverSteps].count, 0);
  EXPECT_EQ(got->means[kAtEffort].count, 0);
}

TEST(Aggregate, FailsWhenEveryEpisodeIsTheParticipantsFault) {
  EXPECT_TRUE(AggregateOf({Episode(0, Outcome::kCrash, 10)})->failed);
  EXPECT_TRUE(AggregateOf({})->failed);
  EXPECT_FALSE(AggregateOf({Episode(0, Outcome::kFailure, 10)})->failed);
}

TEST(Aggregate, RefusesAnEpisodeThatIsThereTwice) {
  EXPECT_FALSE(AggregateOf({Episode(1, Outcome::kCrash, 1), Episode(1, Outcome::kCrash, 1)}).ok());
  EXPECT_FALSE(AggregateOf({Episode(-1, Outcome::kCrash, 1)}).ok());
}

TEST(Aggregate, TellsHowFarEpisodesLieApart) {
  const auto got =
      AggregateOf({Episode(0, Outcome::kFailure, 4), Episode(1, Outcome::kFailure, 10)});
  EXPECT_NEAR(got->means[kAtTime].spread.low, 1.1201081, 1e-6);
  EXPECT_NEAR(got->means[kAtTime].spread.high, 12.8798919, 1e-6);
  const auto one = AggregateOf({Episode(0, Outcome::kFailure, 4)});
  EXPECT_EQ(one->means[kAtTime].count, 1);
  EXPECT_EQ(one->means[kAtTime].spread.deviation, 0);
  EXPECT_EQ(one->means[kAtTime].spread.low, 4);
  EXPECT_EQ(one->means[kAtTime].spread.high, 4);
}

TEST(Aggregate, AnEpisodeMayLackTheLastMetrics) {
  JudgedEpisode cut = Episode(0, Outcome::kFailure, 4);
  cut.verdict.metrics.resize(kAtEffort);
  const auto got = AggregateOf({cut, Episode(1, Outcome::kFailure, 6, 0.5)});
  EXPECT_EQ(got->means[kAtTime].value, 5);
  EXPECT_EQ(got->means[kAtEffort].value, 0.5);
  EXPECT_EQ(got->means[kAtEffort].count, 1);
}

// Wilson's intervals from their formula, worked out apart from this code.
TEST(Aggregate, SuccessRatesHaveWilsonsInterval) {
  struct Case {
    int64_t successes, episodes;
    double deviation, low, high;
  };
  for (const Case& expected :
       {Case{0, 0, 0, 0, 0}, Case{0, 10, 0, 0, 0.2775328}, Case{10, 10, 0, 0.7224672, 1},
        Case{8, 10, 0.4216370, 0.4901625, 0.9433178}, Case{1, 1, 0, 0.2065493, 1},
        Case{1, 2, 0.7071068, 0.0945312, 0.9054688}}) {
    std::vector<JudgedEpisode> episodes;
    for (int64_t i = 0; i < expected.episodes; ++i) {
      episodes.push_back(
          Episode(i, i < expected.successes ? Outcome::kSuccess : Outcome::kFailure, 1));
    }
    SCOPED_TRACE(expected.successes);
    const Spread spread = AggregateOf(episodes)->success_spread;
    EXPECT_NEAR(spread.deviation, expected.deviation, 1e-7);
    EXPECT_NEAR(spread.low, expected.low, 1e-7);
    EXPECT_NEAR(spread.high, expected.high, 1e-7);
    EXPECT_GE(spread.low, 0);
    EXPECT_LE(spread.high, 1);
  }
}

TEST(Aggregate, IntervalsEndAtZeroAndOneExactly) {
  for (int64_t n = 1; n <= 120; ++n) {
    for (const Outcome outcome : {Outcome::kFailure, Outcome::kSuccess}) {
      std::vector<JudgedEpisode> episodes;
      for (int64_t i = 0; i < n; ++i) episodes.push_back(Episode(i, outcome, 1));
      const Spread spread = AggregateOf(episodes)->success_spread;
      if (outcome == Outcome::kFailure) {
        EXPECT_EQ(spread.low, 0.0) << n;
      }
      if (outcome == Outcome::kSuccess) {
        EXPECT_EQ(spread.high, 1.0) << n;
      }
    }
  }
}

TEST(Aggregate, AnEpisodeWithoutASumAddsItsStepsAlone) {
  JudgedEpisode with = Episode(0, Outcome::kFailure, 1);
  with.verdict.steps = 1;
  with.verdict.metrics[kAtPainSum] = 6;
  JudgedEpisode without = Episode(1, Outcome::kCrash, 1);
  without.verdict.steps = 2;
  const auto got = AggregateOf({with, without});
  EXPECT_EQ(got->means[kAtPainOverSteps].value, 2);
  EXPECT_EQ(got->means[kAtPainOverSteps].count, 1);
  EXPECT_EQ(got->participant_faults, 1);
  EXPECT_EQ(AggregateOf({with})->means[kAtPainOverSteps].value, 6) << "of one step";
}

RC_GTEST_PROP(Aggregate, GivesTheSameBitsInAnyOrder, (const std::vector<int>& values)) {
  std::vector<JudgedEpisode> episodes;
  for (const int value : values) {
    const auto index = static_cast<int64_t>(episodes.size());
    episodes.push_back(Episode(index, Outcome::kFailure, value / 7.0, value / 3.0));
  }
  const auto forward = AggregateOf(episodes);
  std::reverse(episodes.begin(), episodes.end());
  const auto backward = AggregateOf(episodes);
  RC_ASSERT(forward->means[kAtTime].value == backward->means[kAtTime].value);
  RC_ASSERT(forward->means[kAtEffort].value == backward->means[kAtEffort].value);
  RC_ASSERT(forward->means[kAtTime].spread.deviation == backward->means[kAtTime].spread.deviation);
}

// Rankings hang on the last bit, so the order of the sums is part of the result.
RC_GTEST_PROP(Aggregate, AddsUpFromTheFirstEpisodeToTheLast, (const std::vector<int>& values)) {
  RC_PRE(!values.empty());
  std::vector<JudgedEpisode> episodes;
  double sum = 0;
  for (const int value : values) {
    const auto index = static_cast<int64_t>(episodes.size());
    episodes.push_back(Episode(index, Outcome::kFailure, value / 7.0));
    sum += value / 7.0;
  }
  const auto got = AggregateOf(episodes);
  RC_ASSERT(got->means[kAtTime].value == sum / static_cast<double>(values.size()));
}

}  // namespace
}  // namespace myograde::scoring
