#include "protocol/lease/track_config.h"

#include <gtest/gtest.h>

#include "protocol/base/config_reader.h"
#include "protocol/tracks/locomotion/track.h"
#include "protocol/tracks/manipulation/track.h"
#include "protocol/base/sha256.h"

namespace myograde {
namespace {

const char kTrackFolder[] = MYOGRADE_SOURCE_DIR "/configs/tracks";

TEST(TrackConfig, EveryShippedConfigParsesInEveryProfile) {
  const auto tracks = ListTracks(kTrackFolder);
  ASSERT_TRUE(tracks.ok()) << tracks.status();
  EXPECT_GE(tracks->size(), 4u);
  for (const std::string& track : *tracks) {
    const auto profiles = LoadProfiles(kTrackFolder, track);
    ASSERT_TRUE(profiles.ok()) << profiles.status();
    EXPECT_TRUE(profiles->configs.contains(profiles->default_profile));
    for (const auto& [profile, config] : profiles->configs) {
      EXPECT_EQ(config.profile, profile);
      const absl::StatusOr<int64_t> steps = config.kind->max_steps(config.rules);
      EXPECT_TRUE(steps.ok() && *steps > 0) << steps.status();
      const auto again = ParseTrackConfig(config.effective, track);
      ASSERT_TRUE(again.ok()) << again.status();
      EXPECT_EQ(again->hash, config.hash);
      const auto alone = LoadTrackConfig(kTrackFolder, track, profile);
      ASSERT_TRUE(alone.ok()) << alone.status();
      EXPECT_EQ(alone->hash, config.hash);
    }
  }
}

TEST(TrackConfig, RefusesBadLimitsUnknownKeysAndNames) {
  const auto good = LoadTrackConfig(kTrackFolder, "manipulation", "");
  ASSERT_TRUE(good.ok()) << good.status();
  EXPECT_EQ(good->profile, "paper");
  for (const char* limit : {"step_s", "memory_bytes", "restarts"}) {
    for (const nlohmann::json& bad :
         {nlohmann::json(0), nlohmann::json(-1), nlohmann::json(1e18)}) {
      nlohmann::json effective = good->effective;
      effective["budgets"][limit] = bad;
      EXPECT_FALSE(ParseTrackConfig(effective, "test").ok()) << limit << " " << bad;
    }
  }
  nlohmann::json unknown = good->effective;
  unknown["seed"] = 1;
  EXPECT_FALSE(ParseTrackConfig(unknown, "test").ok());
  EXPECT_FALSE(LoadTrackConfig(kTrackFolder, "../tracks/manipulation", "").ok());
  EXPECT_FALSE(LoadTrackConfig(kTrackFolder, "manipulation", "none").ok());
}

TEST(Seeds, AreWholeNumbersWithoutRepetition) {
  EXPECT_EQ(ParseSeeds({{"first", 7}, {"count", 2}}, "t").value(), (std::vector<uint64_t>{7, 8}));
  for (const char* bad : {"[]", "[1,1]", "[-1]", "[1.5]", "[9223372036854775808]", "3",
                          R"({"first":0,"count":0})", R"({"first":0,"count":10001})"}) {
    EXPECT_FALSE(ParseSeeds(nlohmann::json::parse(bad), "t").ok()) << bad;
  }
}

TEST(Sha256, AgreesWithThePublishedVector) {
  EXPECT_EQ(Sha256Hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(Layout, HasThePapersSizes) {
  EXPECT_EQ(ObservationOf(ManipulationTrack()).size(), 222);
  EXPECT_EQ(ActionOf(ManipulationTrack()).size(), 80);
  EXPECT_EQ(ObservationOf(LocomotionTrack()).size(), 365);
  EXPECT_EQ(ActionOf(LocomotionTrack()).size(), 55);
}

}  // namespace
}  // namespace myograde
