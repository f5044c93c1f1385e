// Orders for pictures, and which states their pictures show.
#include "protocol/lease/render_order.h"

#include <set>
#include <string>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

namespace myograde {
namespace {

using ::testing::HasSubstr;
using Form = RenderOrder::Form;

RenderOrder FilmOrder() {
  RenderOrder order;
  order.track =
      LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "manipulation", "").value();
  order.cache_dir = "/models";
  order.episodes = {{.logs = {"/a.lcmlog", "/b.lcmlog"}, .title = "a title", .verdict = "success"}};
  order.form = Form::kFilm;
  order.width = 640;
  order.height = 360;
  order.overlay = false;
  order.at_s = 1.5;
  order.speed = 0.25;
  order.threads = 2;
  order.deadline_s = 60;
  return order;
}

TEST(RenderOrder, IsTheSameAfterItsJson) {
  const nlohmann::json text = RenderOrderToJson(FilmOrder());
  const auto read = RenderOrderFromJson(text, "order");
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(RenderOrderToJson(*read), text);
  EXPECT_EQ(read->track.hash, FilmOrder().track.hash);
  EXPECT_EQ(read->episodes.front().logs.back(), "/b.lcmlog");
  EXPECT_EQ(read->at_s, 1.5);
  RenderOrder without = FilmOrder();
  without.at_s.reset();
  EXPECT_FALSE(RenderOrderFromJson(RenderOrderToJson(without), "order")->at_s.has_value());
}

TEST(RenderOrder, IsRefusedWithTheKeyThatIsWrong) {
  const std::pair<const char*, nlohmann::json> changes[] = {
      {"width", 15},      {"height", 4097}, {"speed", 0},          {"speed", "fast"},
      {"threads", 0},     {"columns", 17},  {"deadline_s", 0},     {"frames_per_second", 1000},
      {"form", "poster"}, {"at_s", -1},     {"overlay", "please"}, {"episodes", nlohmann::json::array()},
      {"track", 5},       {"more", 1}};
  for (const auto& [key, value] : changes) {
    nlohmann::json text = RenderOrderToJson(FilmOrder());
    text[key] = value;
    const auto read = RenderOrderFromJson(text, "order");
    EXPECT_TRUE(absl::IsInvalidArgument(read.status())) << key << ": " << read.status();
    EXPECT_THAT(std::string(read.status().message()), HasSubstr(key));
  }
}

TEST(RenderOrder, OfSeveralEpisodesIsForAStrip) {
  RenderOrder order = FilmOrder();
  order.episodes.push_back(order.episodes.front());
  EXPECT_THAT(RenderOrderFromJson(RenderOrderToJson(order), "order").status().ToString(),
              HasSubstr("must have 1 to 1 entries for a film"));
  order.form = Form::kStrip;
  EXPECT_TRUE(RenderOrderFromJson(RenderOrderToJson(order), "order").ok());
  order.episodes.front().logs.clear();
  EXPECT_THAT(RenderOrderFromJson(RenderOrderToJson(order), "order").status().ToString(),
              HasSubstr("must name at least one file"));
}

RC_GTEST_PROP(FilmSchedule, ShowsStatesInOrderAndTheLastOneLongEnough, ()) {
  RenderOrder order;
  order.form = Form::kFilm;
  order.speed = *rc::gen::element(0.01, 0.1, 0.5, 1.0, 2.0, 100.0);
  const auto steps = *rc::gen::inRange<int64_t>(1, 3000);
  const double period = *rc::gen::element(0.005, 0.01, 0.02);
  const int64_t frames = FilmFrames(order, steps, period);
  RC_ASSERT(StepOfFrame(order, 0, steps, period) == 1);
  RC_ASSERT(StepOfFrame(order, frames - 1, steps, period) == steps);
  int64_t held = 0;
  for (int64_t frame = 1; frame < frames; ++frame) {
    const int64_t step = StepOfFrame(order, frame, steps, period);
    RC_ASSERT(step >= StepOfFrame(order, frame - 1, steps, period));
    if (step == steps) ++held;
  }
  if (steps > 1) RC_ASSERT(static_cast<double>(held) >= kFilmHoldSeconds * order.frames_per_second);
}

TEST(FilmSchedule, IsInRealTimeUnlessAskedOtherwise) {
  RenderOrder order;
  order.form = Form::kFilm;
  // 10 s of 100 Hz, and 1.5 s of the last state.
  EXPECT_EQ(FilmFrames(order, 1000, 0.01), 346);
  EXPECT_EQ(StepOfFrame(order, 30, 1000, 0.01), 100);
  order.speed = 0.5;
  EXPECT_EQ(FilmFrames(order, 1000, 0.01), 646);
  EXPECT_EQ(StepOfFrame(order, 30, 1000, 0.01), 50);
}

TEST(FilmSchedule, OfPicturesAndStripsIsWithinTheEpisode) {
  RenderOrder order;
  EXPECT_EQ(StepOfMoment(order, 250, 0.01), 250);
  order.at_s = 1.5;
  EXPECT_EQ(StepOfMoment(order, 250, 0.01), 150);
  order.at_s = 100;
  EXPECT_EQ(StepOfMoment(order, 250, 0.01), 250);
  order.at_s = 0;
  EXPECT_EQ(StepOfMoment(order, 250, 0.01), 1);
  order.columns = 5;
  EXPECT_EQ(StepOfColumn(order, 0, 100), 1);
  EXPECT_EQ(StepOfColumn(order, 2, 100), 50);
  EXPECT_EQ(StepOfColumn(order, 4, 100), 100);
  EXPECT_EQ(StepOfColumn(order, 3, 1), 1);
  order.columns = 1;
  EXPECT_EQ(StepOfColumn(order, 0, 100), 100);
}

}  // namespace
}  // namespace myograde
