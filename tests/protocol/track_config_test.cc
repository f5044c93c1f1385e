#include "protocol/track_config.h"

#include <gtest/gtest.h>

#include "protocol/config_reader.h"
#include "protocol/layout.h"
#include "protocol/rules_locomotion.h"
#include "protocol/rules_manipulation.h"
#include "protocol/sha256.h"

namespace myograde {
namespace {

const char kTrackFolder[] = MYOGRADE_SOURCE_DIR "/configs/tracks";

TEST(TrackConfig, EveryShippedConfigParsesInEveryProfile) {
  const auto tracks = ListTracks(kTrackFolder);
  ASSERT_TRUE(tracks.ok()) << tracks.status();
  EXPECT_GE(tracks->size(), 4u);
  for (const std::string& track : *tracks) {
    const auto profiles = ListProfiles(kTrackFolder, track);
    ASSERT_TRUE(profiles.ok()) << profiles.status();
    for (const std::string& profile : *profiles) {
      const auto config = LoadTrackConfig(kTrackFolder, track, profile);
      ASSERT_TRUE(config.ok()) << config.status();
      const bool arm = config->kind == TrackKind::kManipulation;
      const absl::Status rules = arm ? ParseManipulationRules(config->rules, track).status()
                                     : ParseLocomotionRules(config->rules, track).status();
      EXPECT_TRUE(rules.ok()) << rules;
      const auto again = ParseTrackConfig(config->effective, track);
      ASSERT_TRUE(again.ok()) << again.status();
      EXPECT_EQ(again->hash, config->hash);
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

TEST(Layout, HasThePapersSizesWithoutGaps) {
  for (const TrackKind kind : {TrackKind::kManipulation, TrackKind::kLocomotion}) {
    int offset = 0;
    for (const Part& part : ObservationLayout(kind)) {
      EXPECT_EQ(part.offset, offset);
      offset += part.size;
    }
    EXPECT_EQ(offset, kind == TrackKind::kManipulation ? 222 : 365);
    EXPECT_EQ(ActionSize(kind), kind == TrackKind::kManipulation ? 80 : 55);
    EXPECT_EQ(ActionBounds(kind, ActionConvention::kDirect).size(), ActionNames(kind).size());
    for (const Bounds& bounds : ObservationBounds(kind)) EXPECT_LT(bounds.low, bounds.high);
  }
}

}  // namespace
}  // namespace myograde
