// What answers and receipts have of verdicts and aggregates, and the entries that boards make of it.
#include "scoring/aggregate_json.h"

#include <cmath>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace myograde::scoring {
namespace {

using nlohmann::json;
using testing::Contains;

// An episode with a value of each metric but those of `without`, other ones for each index.
JudgedEpisode EpisodeWith(const ScoredTrack& track, int64_t index, Outcome outcome,
                        const std::set<std::string_view>& without = {}) {
  JudgedEpisode episode{.index = index, .verdict = {}};
  episode.verdict.outcome = outcome;
  episode.verdict.steps = 10 + index;
  for (const Metric& metric : track.metrics) {
    const double value = std::sqrt(static_cast<double>(episode.verdict.metrics.size() + 2)) +
                         static_cast<double>(index);
    episode.verdict.metrics.push_back(without.contains(metric.name) ? std::nullopt
                                                                    : std::optional(value));
  }
  return episode;
}

Aggregate ThreeEpisodesOf(const ScoredTrack& track, const std::set<std::string_view>& without = {}) {
  return AggregateEpisodes(track.metrics, {EpisodeWith(track, 0, Outcome::kSuccess, without),
                                           EpisodeWith(track, 1, Outcome::kFailure, without),
                                           EpisodeWith(track, 2, Outcome::kSuccess, without)})
      .value();
}

std::set<std::string_view> RankedMetrics(const ScoredTrack& track) {
  std::set<std::string_view> ranked;
  for (const Metric& metric : track.metrics) {
    if (metric.ranked) ranked.insert(metric.name);
  }
  return ranked;
}

TEST(AggregateJson, GivesTheEntryThatTheAggregateGives) {
  for (const ScoredTrack* track : ScoredTracks()) {
    SCOPED_TRACE(track->name);
    std::set<std::string_view> some = RankedMetrics(*track);
    some.erase(some.begin());
    for (const std::set<std::string_view>& without : {std::set<std::string_view>(), some}) {
      const Aggregate aggregate = ThreeEpisodesOf(*track, without);
      const json text = AggregateToJson(*track, aggregate);
      EXPECT_TRUE(HasRankedNumbers(*track, text));
      const BoardEntry direct = MakeEntry(track->metrics, aggregate);
      // Through its text, as the store keeps it: every bit stays.
      const BoardEntry read = EntryOfJson(*track, json::parse(text.dump()));
      EXPECT_EQ(read.numbers, direct.numbers);
      EXPECT_EQ(read.successes, 2);
      EXPECT_EQ(read.successes, direct.successes);
      EXPECT_EQ(read.episodes, direct.episodes);
    }
  }
}

TEST(AggregateJson, HasEveryMetricAndTheSpreadsThatTheTrackShows) {
  for (const ScoredTrack* track : ScoredTracks()) {
    SCOPED_TRACE(track->name);
    const json text = AggregateToJson(*track, ThreeEpisodesOf(*track));
    EXPECT_EQ(text["episodes"], 3);
    EXPECT_DOUBLE_EQ(text["success_rate"], 2.0 / 3);
    EXPECT_TRUE(text["spread"]["success_rate"].contains("low"));
    for (const Metric& metric : track->metrics) {
      EXPECT_TRUE(text[metric.name].is_number()) << metric.name;
      EXPECT_EQ(text["spread"].contains(metric.name), metric.spread) << metric.name;
    }
    for (const std::string_view key : track->null_means) EXPECT_TRUE(text.at(key).is_null()) << key;
    for (const std::string_view key : track->null_spreads) {
      EXPECT_TRUE(text["spread"].at(key).is_null()) << key;
    }
    EXPECT_TRUE(AggregateToJson(*track, Aggregate()).is_null()) << "without an episode";
  }
}

TEST(AggregateJson, ANumberThatNoEpisodeHasIsNull) {
  const ScoredTrack& track = *ScoredTracks().front();
  const std::string_view name = *RankedMetrics(track).begin();
  const json text = AggregateToJson(track, ThreeEpisodesOf(track, {name}));
  EXPECT_TRUE(text.at(name).is_null());
  EXPECT_THAT(EntryOfJson(track, text).numbers, Contains(std::optional<double>()));
}

TEST(EntryOfJson, TakesWhatIsNoNumberForNone) {
  const ScoredTrack& track = *ScoredTracks().front();
  for (const json& strange : {json(), json("text"), json::array({1}),
                              json{{"successes", "7"}, {"episodes", 1.5}, {"time_s", true}}}) {
    const BoardEntry entry = EntryOfJson(track, strange);
    EXPECT_EQ(entry.successes, 0) << strange;
    EXPECT_EQ(entry.episodes, 0) << strange;
    EXPECT_EQ(entry.numbers.size(), RankedMetrics(track).size());
    EXPECT_THAT(entry.numbers, testing::Each(std::optional<double>())) << strange;
  }
}

TEST(HasRankedNumbers, AsksForEveryRankedOneAndForNoOther) {
  for (const ScoredTrack* track : ScoredTracks()) {
    for (const Metric& metric : track->metrics) {
      json text = AggregateToJson(*track, ThreeEpisodesOf(*track));
      text.erase(std::string(metric.name));
      EXPECT_EQ(HasRankedNumbers(*track, text), !metric.ranked) << track->name << " " << metric.name;
    }
    EXPECT_FALSE(HasRankedNumbers(*track, nullptr));
  }
}

TEST(MetricsToJson, HasWhatWasJudgedAndNullForTheRest) {
  for (const ScoredTrack* track : ScoredTracks()) {
    SCOPED_TRACE(track->name);
    const std::string_view missing = track->metrics.front().name;
    const JudgedEpisode episode = EpisodeWith(*track, 0, Outcome::kSuccess, {missing});
    const json metrics = MetricsToJson(*track, episode.verdict);
    EXPECT_EQ(metrics["success"], 1);
    EXPECT_EQ(MetricsToJson(*track, EpisodeWith(*track, 0, Outcome::kFailure).verdict)["success"], 0);
    for (size_t i = 0; i < track->metrics.size(); ++i) {
      const Metric& metric = track->metrics[i];
      ASSERT_EQ(metrics.contains(metric.name), metric.source == Metric::Source::kJudged)
          << metric.name;
      if (!metrics.contains(metric.name)) continue;
      EXPECT_EQ(metrics[metric.name],
                metric.name == missing ? json() : json(*episode.verdict.metrics[i]));
    }
    for (const std::string_view key : track->null_metrics) EXPECT_TRUE(metrics.at(key).is_null());
  }
}

TEST(ShownMetrics, AddsThoseOfTheOfficialFiguresWhereTheyAreReported) {
  for (const ScoredTrack* track : ScoredTracks()) {
    SCOPED_TRACE(track->name);
    TrackScoring scoring;
    scoring.track = track;
    const auto names = [&] {
      std::set<std::string> shown;
      for (const json& metric : ShownMetrics(scoring)) shown.insert(metric["name"]);
      return shown;
    };
    const std::set<std::string> always = names();
    scoring.official_figures = true;
    const std::set<std::string> all = names();
    for (const Metric& metric : track->metrics) {
      const std::string name(metric.name);
      EXPECT_EQ(always.contains(name), metric.shown == Metric::Shown::kAlways) << name;
      EXPECT_EQ(all.contains(name), metric.shown == Metric::Shown::kAlways ||
                                        metric.shown == Metric::Shown::kWithOfficialFigures)
          << name;
      const json shown = MetricToJson(metric);
      EXPECT_EQ(shown["title"], metric.title);
      EXPECT_EQ(shown["unit"], metric.unit);
      EXPECT_EQ(shown["better"], metric.better == Better::kLess   ? "less"
                                 : metric.better == Better::kMore ? "more"
                                                                  : "neither");
    }
  }
}

}  // namespace
}  // namespace myograde::scoring
