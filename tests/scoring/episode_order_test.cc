// The order of an evaluation's episodes, against the boards themselves.
#include "scoring/episode_order.h"

#include <cmath>
#include <map>
#include <optional>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/lease/track_config.h"
#include "protocol/tracks/registry.h"

namespace myograde::scoring {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

TrackScoring Shipped(const std::string& name) {
  const TrackConfig config =
      LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", name, "").value();
  return FindScoredTrack(config.kind->name)->parse(config.scoring, name).value();
}

// `values` by the names of metrics; the others have none.
JudgedEpisode Episode(const TrackScoring& track, int64_t index, Outcome outcome,
                      const std::map<std::string, double>& values) {
  JudgedEpisode episode = {.index = index, .verdict = {}};
  episode.verdict.outcome = outcome;
  episode.verdict.steps = 100;
  for (const Metric& metric : track.track->metrics) {
    const auto found = values.find(std::string(metric.name));
    episode.verdict.metrics.push_back(
        found == values.end() ? std::nullopt : std::optional<double>(found->second));
  }
  return episode;
}

std::vector<int64_t> OrderOf(const TrackScoring& track,
                             const std::vector<JudgedEpisode>& episodes) {
  const auto order = EpisodesInOrder(track, episodes);
  EXPECT_TRUE(order.ok()) << order.status();
  return order.value_or(std::vector<int64_t>());
}

TEST(EpisodeOrder, IsThatOfATieredBoard) {
  const TrackScoring track = Shipped("manipulation");
  const auto episode = [&](int64_t index, Outcome outcome, double time, double effort) {
    return Episode(track, index, outcome, {{"time_s", time}, {"effort", effort}});
  };
  EXPECT_THAT(OrderOf(track, {episode(0, Outcome::kCrash, 10, 0),
                              episode(1, Outcome::kFailure, 3, 0.1),
                              episode(2, Outcome::kSuccess, 9, 0.1),
                              episode(3, Outcome::kSuccess, 5, 0.3),
                              episode(4, Outcome::kFailure, 2, 0.1),
                              // In one band with 3, as it takes hardly longer, and with less effort.
                              episode(5, Outcome::kSuccess, 5.1, 0.2)}),
              ElementsAre(5, 3, 2, 4, 1, 0));
}

TEST(EpisodeOrder, IsWithoutPhantoms) {
  const TrackScoring track = Shipped("manipulation");
  const auto episode = [&](int64_t index, Outcome outcome) {
    return Episode(track, index, outcome, {{"time_s", 5}, {"effort", 0.1}});
  };
  JudgedEpisode phantom = episode(2, Outcome::kFailure);
  phantom.verdict.reason = ParseFailureReason("phantom").value();
  EXPECT_THAT(OrderOf(track, {episode(0, Outcome::kFailure), episode(1, Outcome::kSuccess), phantom}),
              ElementsAre(1, 0));
}

TEST(EpisodeOrder, IsThatOfADistanceBoard) {
  const TrackScoring track = Shipped("locomotion");
  const auto episode = [&](int64_t index, double distance, double time) {
    return Episode(track, index, Outcome::kFailure,
                   {{"distance_m", distance}, {"time_s", time}, {"effort", 0.1}, {"pain", 0.1}});
  };
  EXPECT_THAT(OrderOf(track, {episode(0, 5, 30), episode(1, 90, 30), episode(2, 40, 20),
                              episode(3, 0.1, 1)}),
              ElementsAre(1, 2, 0, 3));
}

TEST(EpisodeOrder, PutsFaultsLastAndEqualOnesByIndex) {
  const TrackScoring track = Shipped("manipulation");
  const auto same = [&](int64_t index, Outcome outcome) {
    return Episode(track, index, outcome, {{"time_s", 4}, {"effort", 0.1}});
  };
  EXPECT_THAT(OrderOf(track, {same(7, Outcome::kStepTimeout), same(3, Outcome::kSuccess),
                              same(1, Outcome::kSuccess), same(2, Outcome::kCrash)}),
              ElementsAre(1, 3, 2, 7));
  EXPECT_THAT(OrderOf(track, {}), IsEmpty());
  EXPECT_TRUE(absl::IsInvalidArgument(
      EpisodesInOrder(track, {same(1, Outcome::kSuccess), same(1, Outcome::kSuccess)})
          .status()));
}

TEST(EpisodeOrder, TellsWhatCantBeOrdered) {
  const TrackScoring track = Shipped("manipulation");
  const JudgedEpisode negative = Episode(track, -1, Outcome::kSuccess, {{"time_s", 4}});
  EXPECT_TRUE(absl::IsInvalidArgument(EpisodesInOrder(track, {negative}).status()));
  const JudgedEpisode infinite =
      Episode(track, 0, Outcome::kSuccess, {{"time_s", HUGE_VAL}, {"effort", 0.1}});
  EXPECT_TRUE(absl::IsInvalidArgument(EpisodesInOrder(track, {infinite}).status()));
}

std::vector<std::string> Picked(const std::vector<int64_t>& order) {
  std::vector<std::string> out;
  for (const PickedEpisode& picked : BestMedianWorst(order)) {
    out.push_back(std::string(picked.place) + " " + std::to_string(picked.index));
  }
  return out;
}

TEST(BestMedianWorst, PicksDifferentEpisodes) {
  EXPECT_THAT(Picked({}), IsEmpty());
  EXPECT_THAT(Picked({4}), ElementsAre("only 4"));
  EXPECT_THAT(Picked({4, 2}), ElementsAre("best 4", "worst 2"));
  EXPECT_THAT(Picked({4, 2, 9}), ElementsAre("best 4", "median 2", "worst 9"));
  EXPECT_THAT(Picked({4, 2, 9, 1}), ElementsAre("best 4", "median 2", "worst 1"));
  EXPECT_THAT(Picked({4, 2, 9, 1, 0}), ElementsAre("best 4", "median 9", "worst 0"));
}

}  // namespace
}  // namespace myograde::scoring
