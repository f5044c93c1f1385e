// Pictures of each track's environment.
#include "sim/render/renderer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <map>
#include <memory>
#include <numbers>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/lease/track_config.h"
#include "sim/tracks.h"
#include "tests/sim/golden.h"

// Mesa keeps some hundred bytes of each context.
extern "C" const char* __lsan_default_suppressions() { return "leak:libOSMesa"; }

namespace myograde::sim {
namespace {

using ::testing::HasSubstr;

constexpr int kWidth = 160;
constexpr int kHeight = 120;

using Picture = std::vector<uint8_t>;

class PicturesOf : public testing::Test {
 protected:
  // At the start of an episode. Mesa compiles for each renderer, so a track's tests share one; the best
  // pictures take thrice the time of fast ones, so only one track's are.
  void Make(const SimulatedTrack& track) {
    track_ = &track;
    Made& made = made_[&track];
    if (made.renderer == nullptr) {
      const auto config = OfficialConfig(track);
      ASSERT_TRUE(config.ok()) << config.status();
      auto environment = MakeEnvironment(*config, CacheDir());
      ASSERT_TRUE(environment.ok()) << environment.status();
      const Quality quality = &track == OneTrack() ? Quality::kBest : Quality::kFast;
      auto renderer = Renderer::Make((*environment)->model(), kWidth, kHeight, quality);
      ASSERT_TRUE(renderer.ok()) << renderer.status();
      made = {*std::move(environment), *std::move(renderer)};
    }
    environment_ = made.environment.get();
    renderer_ = made.renderer.get();
    environment_->Reset(7);
  }

  static const SimulatedTrack* OneTrack() { return &SimulatedTracks().back(); }

  Picture Draw(const CameraView& view) {
    Picture rgb(static_cast<size_t>(kWidth) * kHeight * 3);
    const absl::Status status = renderer_->Draw(environment_->data(), view, rgb);
    EXPECT_TRUE(status.ok()) << status;
    return rgb;
  }

  // With MYOGRADE_PICTURES, a folder, they can be looked at.
  void Keep(const Picture& rgb, const std::string& name) const {
    const char* folder = std::getenv("MYOGRADE_PICTURES");
    if (folder == nullptr) return;
    std::ofstream file(std::string(folder) + "/" + std::string(track_->kind->name) + name);
    file << "P6 " << kWidth << " " << kHeight << " 255\n";
    file.write(reinterpret_cast<const char*>(rgb.data()), std::ssize(rgb));
  }

  const SimulatedTrack* track_ = nullptr;
  Environment* environment_ = nullptr;
  Renderer* renderer_ = nullptr;

 private:
  struct Made {
    std::unique_ptr<Environment> environment;
    std::unique_ptr<Renderer> renderer;
  };
  static inline std::map<const SimulatedTrack*, Made> made_;
};

class Pictures : public PicturesOf, public testing::WithParamInterface<const SimulatedTrack*> {
 protected:
  void SetUp() override { Make(*GetParam()); }
};

// What does not depend on the track.
class PicturesOfOneTrack : public PicturesOf {
 protected:
  void SetUp() override { Make(*OneTrack()); }
};

size_t Colours(const Picture& rgb) {
  std::set<std::array<uint8_t, 3>> colours;
  for (size_t i = 0; i < rgb.size(); i += 3) colours.insert({rgb[i], rgb[i + 1], rgb[i + 2]});
  return colours.size();
}

TEST_P(Pictures, ShowTheStateAndLeaveItAsItIs) {
  const std::vector<double> before(environment_->state().begin(), environment_->state().end());
  const Picture first = Draw(track_->view);
  Keep(first, "-first.ppm");
  EXPECT_GT(Colours(first), 500U);  // neither empty nor flat
  EXPECT_EQ(first, Draw(track_->view));
  EXPECT_EQ(before, std::vector<double>(environment_->state().begin(),
                                        environment_->state().end()));

  const std::vector<double> action(static_cast<size_t>(environment_->action_size()), 1.0);
  for (int step = 0; step < 20; ++step) environment_->Step(action);
  const Picture later = Draw(track_->view);
  Keep(later, "-later.ppm");
  EXPECT_NE(first, later);
}

// What a camera sees moves down as the camera rises.
TEST_P(Pictures, HaveTheirTopRowFirst) {
  constexpr int kMoved = 15;  // rows, at the place that is looked at
  CameraView level = track_->view;
  level.elevation_deg = 0;
  const Picture low = Draw(level);
  const double seen_m = 2 * level.distance_m * std::tan(22.5 * std::numbers::pi / 180);
  level.look_at[2] += seen_m * kMoved / kHeight;
  const Picture high = Draw(level);
  Keep(low, "-level.ppm");
  const auto difference = [&](int rows_down) {
    double sum = 0;
    for (int i = kMoved * kWidth * 3; i < (kHeight - kMoved) * kWidth * 3; ++i) {
      sum += std::abs(high[i + rows_down * kWidth * 3] - low[i]);
    }
    return sum;
  };
  EXPECT_LT(difference(kMoved), difference(-kMoved));
}

// The environment changes sizes and terrain from episode to episode.
TEST_P(Pictures, OfOtherEpisodesDiffer) {
  const Picture first = Draw(track_->view);
  environment_->Reset(8);
  const Picture second = Draw(track_->view);
  Keep(second, "-second.ppm");
  EXPECT_NE(first, second);
}

TEST_F(PicturesOfOneTrack, OfTheWrongSizeOrAnUnknownBodyAreRefused) {
  Picture small(5);
  EXPECT_THAT(renderer_->Draw(environment_->data(), track_->view, small).ToString(),
              HasSubstr("160 by 120 pixels does not have 5 bytes"));
  Picture rgb(static_cast<size_t>(kWidth) * kHeight * 3);
  EXPECT_THAT(renderer_->Draw(environment_->data(), {.body = "tail"}, rgb).ToString(),
              HasSubstr("the model has no body tail"));
}

TEST_F(PicturesOfOneTrack, CanBeDrawnByTwoRenderersInTurn) {
  auto other = Renderer::Make(environment_->model(), 64, 48);
  ASSERT_TRUE(other.ok()) << other.status();
  Picture small(64 * 48 * 3);
  const Picture first = Draw(track_->view);
  ASSERT_TRUE((*other)->Draw(environment_->data(), track_->view, small).ok());
  EXPECT_EQ(first, Draw(track_->view));
  other->reset();
  EXPECT_EQ(first, Draw(track_->view));
}

TEST_F(PicturesOfOneTrack, HaveSidesWithinLimits) {
  for (const auto& [width, height] : {std::pair{0, 10}, {10, -1}, {4097, 10}}) {
    EXPECT_TRUE(absl::IsInvalidArgument(
        Renderer::Make(environment_->model(), width, height).status()));
  }
}

std::vector<const SimulatedTrack*> Tracks() {
  std::vector<const SimulatedTrack*> tracks;
  for (const SimulatedTrack& track : SimulatedTracks()) tracks.push_back(&track);
  return tracks;
}

INSTANTIATE_TEST_SUITE_P(OfEachTrack, Pictures, testing::ValuesIn(Tracks()),
                         [](const auto& each) { return std::string(each.param->kind->name); });

}  // namespace
}  // namespace myograde::sim
