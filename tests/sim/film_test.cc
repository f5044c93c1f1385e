// Pictures and films of recorded episodes, from the shipped reference logs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/lease/render_order.h"
#include "protocol/log/episode_log.h"
#include "protocol/log/packed_log.h"
#include "sim/film/overlay.h"
#include "sim/film/png.h"
#include "sim/film/renders.h"
#include "sim/tracks.h"
#include "tests/sim/golden.h"

namespace myograde::sim {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;
using Form = RenderOrder::Form;

constexpr int kTileWidth = 64;
constexpr int kTileHeight = 36;

std::string ReferenceLog(const std::string& track) {
  return absl::StrCat(MYOGRADE_SOURCE_DIR, "/configs/reference/", track, ".lcmlog.zst");
}

EpisodeLog ReadReference(const std::string& track) {
  return ParseEpisodeLog(UnpackLog(ReadFile(ReferenceLog(track)).value()).value()).value();
}

// The track with the smallest model.
const EpisodeLog& ElbowLog() {
  static const EpisodeLog log = ReadReference("elbow");
  return log;
}

RenderOrder SmallOrder(Form form) {
  RenderOrder order;
  order.track = ElbowLog().header.track;
  order.cache_dir = CacheDir();
  order.episodes = {{.logs = {ReferenceLog("elbow")}, .title = "", .verdict = ""}};
  order.form = form;
  order.width = kTileWidth;
  order.height = kTileHeight;
  return order;
}

// What is written for an order.
absl::StatusOr<std::string> Rendered(const RenderOrder& order) {
  auto renders = Renders::Prepare(order);
  if (!renders.ok()) return renders.status();
  FILE* file = std::tmpfile();
  const absl::Status status = renders->Write(fileno(file));
  std::rewind(file);
  absl::StatusOr<std::string> bytes = ReadAll(fileno(file), "pictures");
  std::fclose(file);
  return status.ok() ? bytes : status;
}

struct Image {
  int width = 0;
  int height = 0;
  std::vector<uint8_t> rgb;
};

Image DecodePng(const std::string& bytes) {
  png_image png = {};
  png.version = PNG_IMAGE_VERSION;
  EXPECT_NE(png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()), 0) << png.message;
  png.format = PNG_FORMAT_RGB;
  Image image = {static_cast<int>(png.width), static_cast<int>(png.height),
                 std::vector<uint8_t>(PNG_IMAGE_SIZE(png))};
  EXPECT_NE(png_image_finish_read(&png, nullptr, image.rgb.data(), 0, nullptr), 0) << png.message;
  return image;
}

TEST(Png, HoldsTheVeryPixels) {
  std::vector<uint8_t> rgb;
  for (int i = 0; i < 5 * 3 * 3; ++i) rgb.push_back(static_cast<uint8_t>(i * 37));
  const auto png = EncodePng(rgb, 5, 3);
  ASSERT_TRUE(png.ok()) << png.status();
  const Image image = DecodePng(*png);
  EXPECT_EQ(image.width, 5);
  EXPECT_EQ(image.height, 3);
  EXPECT_EQ(image.rgb, rgb);
  EXPECT_EQ(*EncodePng(rgb, 5, 3), *png);
}

TEST(Film, HasAPictureForEachMoment) {
  const RenderOrder order = SmallOrder(Form::kFilm);
  const auto film = Rendered(order);
  ASSERT_TRUE(film.ok()) << film.status();
  const int64_t frames =
      FilmFrames(order, ElbowLog().steps(), ElbowLog().header.track.kind->control_period_s);
  const size_t frame = kTileWidth * kTileHeight * 3;
  ASSERT_EQ(film->size(), static_cast<size_t>(frames) * frame);
  EXPECT_NE(film->substr(0, frame), film->substr(film->size() - frame));  // something moves
  EXPECT_EQ(film->substr(film->size() - 2 * frame, frame), film->substr(film->size() - frame));
}

TEST(Picture, IsTheSameEachTimeAndOfTheMomentThatIsAskedFor) {
  RenderOrder order = SmallOrder(Form::kPicture);
  order.overlay = false;
  const auto last = Rendered(order);
  ASSERT_TRUE(last.ok()) << last.status();
  EXPECT_EQ(DecodePng(*last).width, kTileWidth);
  EXPECT_EQ(*Rendered(order), *last);
  order.at_s = 0.2;
  EXPECT_NE(*Rendered(order), *last);
  order.at_s.reset();
  order.overlay = true;
  EXPECT_NE(*Rendered(order), *last);
}

TEST(Strip, HasARowForEachEpisode) {
  RenderOrder order = SmallOrder(Form::kStrip);
  order.columns = 3;
  order.overlay = false;
  order.episodes.push_back(order.episodes.front());
  const auto strip = Rendered(order);
  ASSERT_TRUE(strip.ok()) << strip.status();
  const Image image = DecodePng(*strip);
  EXPECT_EQ(image.width, 3 * kTileWidth + 2 * 4);
  EXPECT_EQ(image.height, 2 * kTileHeight + 4);
  const auto row = [&](int y) {
    const auto begin = image.rgb.begin() + static_cast<std::ptrdiff_t>(y) * image.width * 3;
    return std::vector<uint8_t>(begin, begin + static_cast<std::ptrdiff_t>(image.width) * 3);
  };
  // The same episode twice, with white paper between.
  for (int y = 0; y < kTileHeight; ++y) EXPECT_EQ(row(y), row(y + kTileHeight + 4));
  EXPECT_EQ(row(kTileHeight), std::vector<uint8_t>(static_cast<size_t>(image.width) * 3, 255));
}

TEST(Film, RefusesALogThatIsAltered) {
  const std::string whole = UnpackLog(ReadFile(ReferenceLog("elbow")).value()).value();
  const std::string path =
      absl::StrCat(std::filesystem::temp_directory_path().string(), "/film-", getpid());
  std::string flipped = whole;
  flipped[whole.size() / 2] ^= 1;
  for (const std::string& bad :
       {flipped, whole.substr(0, whole.size() - 1), std::string("no log"), std::string()}) {
    ASSERT_TRUE(WriteFile(path, bad).ok());
    RenderOrder order = SmallOrder(Form::kPicture);
    order.episodes.front().logs = {path};
    const auto picture = Rendered(order);
    EXPECT_TRUE(absl::IsDataLoss(picture.status())) << picture.status();
    EXPECT_THAT(std::string(picture.status().message()), StartsWith(path));
  }
  std::filesystem::remove(path);
}

TEST(Film, RefusesALogOfAnotherConfigAndAMissingOne) {
  RenderOrder order = SmallOrder(Form::kPicture);
  order.episodes.front().logs = {ReferenceLog("manipulation")};
  const auto other = Rendered(order);
  EXPECT_TRUE(absl::IsDataLoss(other.status())) << other.status();
  EXPECT_THAT(other.status().ToString(), HasSubstr("the log is of another track config"));
  order.episodes.front().logs = {"/nowhere/a.lcmlog"};
  EXPECT_TRUE(absl::IsNotFound(Rendered(order).status()));
}

class Overlays : public testing::TestWithParam<const SimulatedTrack*> {};

TEST_P(Overlays, SayWhatIsShownAndHowItEnded) {
  const SimulatedTrack& track = *GetParam();
  const EpisodeLog log = ReadReference(std::string(track.kind->name));
  auto environment = MakeEnvironment(log.header.track, CacheDir());
  ASSERT_TRUE(environment.ok()) << environment.status();
  (*environment)->Reset(log.header.seed);
  RenderOrder order;
  order.episodes = {{.logs = {"a.lcmlog"}, .title = "a title", .verdict = ""}};
  const PictureText early = FilmText(track, order, log, **environment, 10);
  EXPECT_THAT(early.names, HasSubstr("episode\nstep\ntime\n"));
  EXPECT_THAT(early.values, HasSubstr(absl::StrCat("\n10 of ", log.steps(), "\n")));
  EXPECT_EQ(std::ranges::count(early.names, '\n'), std::ranges::count(early.values, '\n'));
  EXPECT_EQ(early.title, "a title");
  EXPECT_EQ(early.caption, "");
  EXPECT_FALSE(track.readings((*environment)->facts()).empty());
  EXPECT_EQ(FilmText(track, order, log, **environment, log.steps()).caption,
            "ended: " + log.end.end);
  order.episodes.front().verdict = "failure: force";
  EXPECT_EQ(FilmText(track, order, log, **environment, log.steps()).caption, "failure: force");
}

INSTANTIATE_TEST_SUITE_P(OfEachTrack, Overlays, testing::ValuesIn([] {
                           std::vector<const SimulatedTrack*> tracks;
                           for (const SimulatedTrack& each : SimulatedTracks()) {
                             tracks.push_back(&each);
                           }
                           return tracks;
                         }()),
                         [](const auto& each) { return std::string(each.param->kind->name); });

TEST(Overlay, SaysThatALogWasCut) {
  EpisodeLog log = ElbowLog();
  log.end.steps = log.end.logged + 5;
  const RenderEpisode episode = {.logs = {}, .title = "best: episode 0", .verdict = "success"};
  EXPECT_THAT(StripText(episode, log, 1, log.steps()).caption,
              HasSubstr(absl::StrCat("after ", log.end.logged, " of ", log.end.steps, " steps")));
  EXPECT_EQ(StripText(episode, log, 0, 1).names, "best: episode 0");
  EXPECT_EQ(StripText(episode, log, 1, 1).names, "");
}

// Titles and verdicts come from people.
TEST(Overlay, BoundsTextsAndTheRendererTakesAnyByte) {
  RenderOrder order = SmallOrder(Form::kPicture);
  std::string hostile;
  for (int i = 1; i < 256; ++i) hostile.push_back(static_cast<char>(i));
  order.episodes.front().title = hostile + std::string(100'000, 'x');
  order.episodes.front().verdict = std::string(100'000, '\xff');
  const auto picture = Rendered(order);
  ASSERT_TRUE(picture.ok()) << picture.status();
  EXPECT_EQ(DecodePng(*picture).width, kTileWidth);
}

}  // namespace
}  // namespace myograde::sim
