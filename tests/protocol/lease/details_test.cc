// Details in records: they come back, are bounded and strict, and are no part of the facts.
#include <limits>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/base/config_reader.h"
#include "protocol/lease/lease.h"
#include "protocol/tracks/registry.h"

namespace myograde {
namespace {

using ::testing::HasSubstr;

EpisodeFacts Measured(const TrackKind& track, const TrackDetails& details) {
  EpisodeFacts facts;
  facts.end = EpisodeEnd::kTime;
  facts.steps = 3;
  facts.track = track.no_facts;
  facts.details = details;
  return facts;
}

LocomotionDetails Walk() {
  LocomotionDetails walk;
  walk.obstacle_heights = {0.1875, std::nullopt, 1.0 / 3};
  walk.pain_by_joint[0] = 0.0000014;
  walk.pain_by_joint[11] = 12.5;
  walk.joint_ranges[3] = {-0.12345, 1.23456, -0.5235987755982988, 2.0943951023931953};
  walk.fall_time = 3.415;
  walk.fall_y = 51.25;
  walk.speed_mean = -0.0;
  return walk;
}

TrackDetails Empty(const TrackKind& track) {
  if (AreFactsOf(track, ManipulationFacts())) return ManipulationDetails();
  if (AreFactsOf(track, LocomotionFacts())) return LocomotionDetails();
  if (AreFactsOf(track, ElbowFacts())) return ElbowDetails();
  if (AreFactsOf(track, ReorientationFacts())) return ReorientationDetails();
  if (AreFactsOf(track, BaodingFacts())) return BaodingDetails();
  if (AreFactsOf(track, RelocationFacts())) return RelocationDetails();
  return ChaseTagDetails();
}

nlohmann::json RecordOf(const EpisodeFacts& facts) {
  return nlohmann::json::parse(LeaseRecordToLine(facts));
}

std::string ErrorOf(const nlohmann::json& record) {
  return std::string(LeaseRecordFromLine(record.dump()).status().message());
}

TEST(Details, ComeBackWithTheRecordOfEveryTrack) {
  for (const TrackKind* track : AllTracks()) {
    SCOPED_TRACE(track->name);
    const std::string line = LeaseRecordToLine(Measured(*track, Empty(*track)));
    const auto back = LeaseRecordFromLine(line);
    ASSERT_TRUE(back.ok()) << back.status();
    EXPECT_TRUE(std::get<EpisodeFacts>(*back).details.has_value());
    EXPECT_EQ(LeaseRecordToLine(*back), line);
    // The channel takes 128 KiB, and a page shows 10,000 episodes.
    EXPECT_LT(DetailsToJson(Empty(*track)).dump().size(), 2048u);
  }
}

TEST(Details, AreRoundedAndStaySoWhenTheyAreReadAndWrittenAgain) {
  const nlohmann::json told = DetailsToJson(Walk());
  EXPECT_EQ(told["obstacle_heights"],
            nlohmann::json({{"hilly", 0.1875}, {"rough", nullptr}, {"stairs", 0.333333}}));
  EXPECT_EQ(told["pain_by_joint"]["hip_adduction_l"], 0.000001);
  EXPECT_EQ(told["pain_by_joint"]["subtalar_angle_l"], 12.5);
  EXPECT_EQ(told["pain_by_joint"].size(), 12u);
  EXPECT_EQ(told["joint_ranges"]["hip_flexion_r"],
            nlohmann::json({-0.1235, 1.2346, -0.5236, 2.0944}));
  EXPECT_EQ(told["joint_ranges"].size(), 14u);
  EXPECT_EQ(told["fall_time"], 3.415);
  const auto back = DetailsFromJson(LocomotionFacts(), told);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(DetailsToJson(*back), told);
}

TEST(Details, AreNoPartOfTheFacts) {
  EpisodeFacts facts = Measured(*FindTrack("locomotion"), Walk());
  const nlohmann::json with = EpisodeFactsToJson(facts);
  facts.details.reset();
  EXPECT_EQ(EpisodeFactsToJson(facts), with);
  EXPECT_FALSE(RecordOf(facts).contains("details"));
}

TEST(Details, RecordsOfEarlierVersionsHaveNone) {
  nlohmann::json record = RecordOf(Measured(*FindTrack("locomotion"), Walk()));
  record.erase("details");
  const auto earlier = LeaseRecordFromLine(record.dump());
  ASSERT_TRUE(earlier.ok()) << earlier.status();
  EXPECT_FALSE(std::get<EpisodeFacts>(*earlier).details.has_value());
}

// Every key of the details, as pointers to places in the record, and one of each object in them.
std::vector<nlohmann::json::json_pointer> Places(const nlohmann::json& record) {
  std::vector<nlohmann::json::json_pointer> places;
  const nlohmann::json::json_pointer root("/details");
  for (const auto& [key, value] : record["details"].items()) {
    places.push_back(root / key);
    if (value.is_object()) places.push_back(root / key / value.begin().key());
  }
  return places;
}

TEST(Details, EachMissingWrongOrUnknownKeyIsAnErrorThatNamesIt) {
  for (const TrackKind* track : AllTracks()) {
    const nlohmann::json good = RecordOf(Measured(*track, Empty(*track)));
    for (const auto& place : Places(good)) {
      nlohmann::json broken = good;
      broken.at(place.parent_pointer()).erase(place.back());
      EXPECT_THAT(ErrorOf(broken), HasSubstr(place.back())) << place;
      for (const nlohmann::json& wrong :
           {nlohmann::json("text"), nlohmann::json(true), nlohmann::json({1, 2, 3}),
            nlohmann::json({1, 2, 3, 4, 5}), nlohmann::json({1, 2, 3, "4"})}) {
        broken = good;
        broken[place] = wrong;
        EXPECT_NE(ErrorOf(broken), "") << place << " " << wrong;
      }
      broken = good;
      broken.at(place.parent_pointer())["surprise"] = 1;
      EXPECT_THAT(ErrorOf(broken), HasSubstr("surprise")) << place;
    }
    for (const nlohmann::json& wrong :
         {nlohmann::json(), nlohmann::json::array(), nlohmann::json("x"), nlohmann::json(1)}) {
      nlohmann::json broken = good;
      broken["details"] = wrong;
      EXPECT_NE(ErrorOf(broken), "") << wrong;
    }
  }
}

TEST(Details, OfAnotherTrackAreAnError) {
  nlohmann::json record = RecordOf(Measured(*FindTrack("locomotion"), Walk()));
  record["details"] = DetailsToJson(ElbowDetails());
  EXPECT_NE(ErrorOf(record), "");
}

TEST(Details, NumbersThatAreNoneAreAnError) {
  LocomotionDetails walk = Walk();
  walk.speed_mean = std::numeric_limits<double>::infinity();
  EXPECT_NE(ErrorOf(RecordOf(Measured(*FindTrack("locomotion"), walk))), "");
}

}  // namespace
}  // namespace myograde
