// The episodes to look at are those that the board's own order puts first, in the middle and last.
#include "server/grading/highlights.h"

#include <string>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace myograde::server {
namespace {

TrackPtr TrackNamed(const std::string& name) {
  auto config = LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", name, "paper");
  if (!config.ok()) return nullptr;
  auto track = MakeTrack(*std::move(config));
  return track.ok() ? *track : nullptr;
}

EpisodeRow RowOf(int64_t index, Outcome outcome, const std::string& metrics, bool log = true) {
  EpisodeRow row;
  row.index = index;
  row.outcome = outcome;
  row.metrics_json = metrics;
  row.facts_json = absl::StrCat(R"({"steps": 100, "log": )",
                                log ? R"({"sha256": "a"})" : "null", "}");
  return row;
}

std::string Walk(double distance, double time) {
  return absl::StrCat(R"({"distance_m": )", distance, R"(, "time_s": )", time,
                      R"(, "effort": 0.1, "pain": 0.1})");
}

TEST(HighlightsOf, GoesByDistanceWhereTheBoardDoes) {
  const TrackPtr track = TrackNamed("locomotion");
  ASSERT_NE(track, nullptr);
  const auto found = HighlightsOf(
      track->scoring, {RowOf(0, Outcome::kFailure, Walk(3, 9)),
                       RowOf(1, Outcome::kSuccess, Walk(100, 80)),
                       RowOf(2, Outcome::kFailure, Walk(0.5, 1)),
                       RowOf(3, Outcome::kFailure, Walk(3, 8)),
                       RowOf(4, Outcome::kFailure, Walk(200, 8), /*log=*/false)});
  ASSERT_TRUE(found.ok()) << found.status();
  // Of the four with a log the better one of the middle two: as far as the other, but faster.
  EXPECT_EQ(*found, (Highlights{.best = 1, .median = 3, .worst = 2}));
}

TEST(HighlightsOf, GoesBySuccessThenTimeThenEffortOnATieredBoard) {
  const TrackPtr track = TrackNamed("manipulation");
  ASSERT_NE(track, nullptr);
  const auto metrics = [](double time, double effort) {
    return absl::StrCat(R"({"time_s": )", time, R"(, "effort": )", effort, "}");
  };
  const auto found = HighlightsOf(
      track->scoring, {RowOf(0, Outcome::kCrash, R"({"time_s": 10, "effort": null})"),
                       RowOf(1, Outcome::kFailure, metrics(10, 0.2)),
                       RowOf(2, Outcome::kSuccess, metrics(6, 0.2)),
                       RowOf(3, Outcome::kSuccess, metrics(5, 0.3)),
                       RowOf(4, Outcome::kSuccess, metrics(5, 0.1))});
  ASSERT_TRUE(found.ok()) << found.status();
  EXPECT_EQ(*found, (Highlights{.best = 4, .median = 2, .worst = 0}));
}

TEST(HighlightsOf, NeedsALogAndReadableRows) {
  const TrackPtr track = TrackNamed("manipulation");
  ASSERT_NE(track, nullptr);
  const EpisodeRow without = RowOf(0, Outcome::kCrash, R"({"time_s": 10})", /*log=*/false);
  EXPECT_EQ(*HighlightsOf(track->scoring, {}), std::nullopt);
  EXPECT_EQ(*HighlightsOf(track->scoring, {without, without}), std::nullopt);
  EXPECT_EQ(*HighlightsOf(track->scoring, {without, RowOf(1, Outcome::kSuccess,
                                                         R"({"time_s": 10})")}),
            (Highlights{.best = 1, .median = 1, .worst = 1}));
  EXPECT_TRUE(absl::IsDataLoss(
      HighlightsOf(track->scoring, {RowOf(0, Outcome::kSuccess, "{")}).status()));
}

}  // namespace
}  // namespace myograde::server
