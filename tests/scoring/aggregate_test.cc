#include "scoring/aggregate.h"

#include <algorithm>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

namespace myograde::scoring {
namespace {

JudgedEpisode Episode(int64_t index, Outcome outcome, double time,
                      std::optional<double> effort = std::nullopt) {
  JudgedEpisode episode{.index = index, .judgement = {}};
  episode.judgement.outcome = outcome;
  episode.judgement.metrics.time = time;
  episode.judgement.metrics.effort = effort;
  return episode;
}

TEST(Aggregate, MeansLeaveOutWhatHasNoResultAndNoSteps) {
  const auto got = AggregateEpisodes({Episode(0, Outcome::kSuccess, 4, 0.2),
                                      Episode(1, Outcome::kCrash, 10),
                                      Episode(2, Outcome::kGraderError, 1e9, 7),
                                      Episode(3, Outcome::kCancelled, 1e9, 7)});
  ASSERT_TRUE(got.ok());
  EXPECT_EQ(got->episodes, 2);
  EXPECT_EQ(got->successes, 1);
  EXPECT_EQ(got->time.value, 7);
  EXPECT_EQ(got->effort.value, 0.2);
  EXPECT_EQ(got->effort.count, 1);
  EXPECT_FALSE(got->failed);
  EXPECT_NEAR(got->time.spread.deviation, 4.242640687119285, 1e-12);
}

// A walk of 60,000 steps and four falls: means of episodes' means would make the pain of the
// walk a fifth of what it was.
TEST(Aggregate, MeansOverStepsDoNotRewardFallingAtOnce) {
  std::vector<JudgedEpisode> episodes;
  for (int64_t i = 0; i < 5; ++i) {
    JudgedEpisode episode = Episode(i, Outcome::kFailure, 1);
    Metrics& metrics = episode.judgement.metrics;
    metrics.steps = i == 0 ? 60000 : 10;
    metrics.pain_sum = i == 0 ? 6000 : 0;
    metrics.effort_sum = i == 0 ? 12000 : 0;
    metrics.pain = metrics.pain_sum / static_cast<double>(metrics.steps);
    episodes.push_back(episode);
  }
  const auto got = AggregateEpisodes(episodes);
  ASSERT_TRUE(got.ok());
  EXPECT_DOUBLE_EQ(got->pain.value, 0.02);
  EXPECT_DOUBLE_EQ(*got->pain_over_steps, 6000.0 / 60040);
  EXPECT_DOUBLE_EQ(*got->effort_over_steps, 12000.0 / 60040);
}

TEST(Aggregate, WithoutAStepThereIsNoMeanOverSteps) {
  const auto got = AggregateEpisodes({Episode(0, Outcome::kCrash, 10)});
  ASSERT_TRUE(got.ok());
  EXPECT_FALSE(got->effort_over_steps || got->pain_over_steps);
  EXPECT_EQ(got->max_touch.count, 0);
}

TEST(Aggregate, FailsWhenEveryEpisodeIsTheParticipantsFault) {
  EXPECT_TRUE(AggregateEpisodes({Episode(0, Outcome::kCrash, 10)})->failed);
  EXPECT_TRUE(AggregateEpisodes({})->failed);
  EXPECT_FALSE(AggregateEpisodes({Episode(0, Outcome::kFailure, 10)})->failed);
}

TEST(Aggregate, RefusesAnEpisodeThatIsThereTwice) {
  EXPECT_FALSE(
      AggregateEpisodes({Episode(1, Outcome::kCrash, 1), Episode(1, Outcome::kCrash, 1)}).ok());
  EXPECT_FALSE(AggregateEpisodes({Episode(-1, Outcome::kCrash, 1)}).ok());
}

RC_GTEST_PROP(Aggregate, GivesTheSameBitsInAnyOrder, (const std::vector<int>& values)) {
  std::vector<JudgedEpisode> episodes;
  for (const int value : values) {
    const auto index = static_cast<int64_t>(episodes.size());
    episodes.push_back(Episode(index, Outcome::kFailure, value / 7.0, value / 3.0));
  }
  const auto forward = AggregateEpisodes(episodes);
  std::reverse(episodes.begin(), episodes.end());
  const auto backward = AggregateEpisodes(episodes);
  RC_ASSERT(forward->time.value == backward->time.value);
  RC_ASSERT(forward->effort.value == backward->effort.value);
  RC_ASSERT(forward->time.spread.deviation == backward->time.spread.deviation);
}

}  // namespace
}  // namespace myograde::scoring
