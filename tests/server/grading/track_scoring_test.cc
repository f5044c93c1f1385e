// The `scoring` section of track configs, as loaded tracks have it.
#include <fstream>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/base/config_reader.h"
#include "protocol/tracks/registry.h"
#include "scoring/locomotion/track.h"
#include "scoring/manipulation/track.h"
#include "server/grading/tracks.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;
using testing::HasSubstr;
using scoring::kMainBoard;
using scoring::LocomotionMetric;
using scoring::ManipulationMetric;
using scoring::TrackScoring;

absl::StatusOr<TrackScoring> ParseTrackScoring(const TrackConfig& config) {
  absl::StatusOr<TrackPtr> track = MakeTrack(config);
  if (!track.ok()) return track.status();
  return (*track)->scoring;
}

const char kTracks[] = MYOGRADE_SOURCE_DIR "/configs/tracks";

TrackConfig Load(const std::string& track, const std::string& profile = "") {
  return LoadTrackConfig(kTracks, track, profile).value();
}

// The error in `track`'s scoring after merging `patch` (RFC 7386).
std::string MistakeOf(const std::string& track, const Json& patch) {
  TrackConfig config = Load(track);
  config.scoring.merge_patch(patch);
  return std::string(ParseTrackScoring(config).status().message());
}

TEST(TrackScoring, ReadsEveryShippedConfigInEveryProfile) {
  int parsed = 0;
  const auto tracks = ListTracks(kTracks);
  for (const std::string& track : *tracks) {
    const auto profiles = LoadProfiles(kTracks, track);
    ASSERT_TRUE(profiles.ok()) << profiles.status();
    for (const auto& [profile, config] : profiles->configs) {
      const auto scoring = ParseTrackScoring(config);
      ASSERT_TRUE(scoring.ok()) << scoring.status();
      EXPECT_TRUE(scoring->boards.contains(kMainBoard));
      EXPECT_EQ(scoring->track->name, config.kind->name);
      ++parsed;
    }
  }
  EXPECT_GE(parsed, 10);
}

scoring::ManipulationJudging ManipulationJudgingOf(const std::string& profile) {
  const TrackConfig config = Load("manipulation", profile);
  ConfigReader reader(config.scoring, "scoring");
  return scoring::ReadManipulationJudging(reader);
}

TEST(TrackScoring, EveryTrackOfTheProtocolIsScored) {
  ASSERT_EQ(AllTracks().size(), scoring::ScoredTracks().size());
  for (const TrackKind* kind : AllTracks()) {
    const scoring::ScoredTrack* track = scoring::FindScoredTrack(kind->name);
    ASSERT_NE(track, nullptr) << kind->name;
    EXPECT_TRUE(std::ranges::any_of(track->metrics, &scoring::Metric::ranked));
  }
}

TEST(TrackScoring, GivesTheNumbersOfTheProfile) {
  const auto paper = ParseTrackScoring(Load("manipulation", "paper")).value();
  const auto rules = ManipulationJudgingOf("paper");
  EXPECT_EQ(rules.success, scoring::SuccessRule::kPlaced);
  EXPECT_EQ(rules.contact_frames, 100);
  EXPECT_TRUE(rules.force_enforced);
  EXPECT_EQ(rules.force_limit_n, 1500);
  EXPECT_EQ(rules.time, scoring::TimeSource::kPlayed);
  EXPECT_EQ(rules.full_time_s, 10);
  EXPECT_EQ(paper.team, scoring::TeamRule::kBest);
  const auto& tiers = std::get<scoring::TieredBoard>(paper.boards.at(kMainBoard).rules);
  EXPECT_EQ(tiers.line_successes, 90);
  EXPECT_EQ(tiers.line_episodes, 100);
  EXPECT_EQ(tiers.bands, scoring::BandsOver::kTime);
  EXPECT_EQ(tiers.band_factor, 1.1);
  EXPECT_EQ(tiers.ties, scoring::Ties::kTime);
  EXPECT_EQ(rules.phantom, ManipulationReason::kPhantom);

  const auto code_rules = ManipulationJudgingOf("myosuite");
  EXPECT_EQ(code_rules.success, scoring::SuccessRule::kSolvedAndContact);
  EXPECT_FALSE(code_rules.force_enforced);
  EXPECT_EQ(code_rules.time, scoring::TimeSource::kReported);
  EXPECT_EQ(ManipulationJudgingOf("as-graded").success, scoring::SuccessRule::kSolved);

  TrackConfig walk = Load("locomotion");
  walk.scoring["team"] = "chosen";
  const auto walking = ParseTrackScoring(walk).value();
  EXPECT_EQ(walking.team, scoring::TeamRule::kChosen);
  ConfigReader reader(walk.scoring, "scoring");
  const scoring::LocomotionJudging walking_rules = scoring::ReadLocomotionJudging(reader);
  EXPECT_EQ(walking_rules.full_time_s, 300);
  EXPECT_EQ(walking_rules.course_m, 100);
  EXPECT_EQ(std::get<scoring::DistanceBoard>(walking.boards.at(kMainBoard).rules).time_from_m, 20);
  EXPECT_EQ(std::get<scoring::DistanceBoard>(walking.boards.at(kMainBoard).rules).band, 0);
  const auto& body = std::get<scoring::PhysiologicalBoard>(walking.boards.at("physiological").rules);
  EXPECT_EQ(body.qualify_m, 20);
  EXPECT_EQ(body.means, scoring::MeansOver::kSteps);
  walk.scoring["boards"]["main"]["distance_band"] = 0.1;
  EXPECT_EQ(std::get<scoring::DistanceBoard>(
                ParseTrackScoring(walk).value().boards.at(kMainBoard).rules).band, 0.1);
}

TEST(TrackScoring, OfficialFiguresAreThoseOfTheProfilesThatReportThem) {
  for (const char* track : {"manipulation", "locomotion"}) {
    EXPECT_FALSE(ParseTrackScoring(Load(track, "paper"))->official_figures) << track;
    EXPECT_TRUE(ParseTrackScoring(Load(track, "myosuite"))->official_figures) << track;
    EXPECT_TRUE(ParseTrackScoring(Load(track, "as-graded"))->official_figures) << track;
  }
}

TEST(TrackScoring, TellsMistakesOfManipulation) {
  EXPECT_THAT(MistakeOf("manipulation", {{"success", "won"}}),
              testing::AllOf(HasSubstr("manipulation (profile paper): scoring: \"success\""),
                             HasSubstr("placed, solved-and-contact, solved")));
  for (const char* limit : {"contact_frames", "force_limit_n", "full_time_s"}) {
    for (const Json& bad : {Json(0), Json(-1), Json("1")}) {
      EXPECT_THAT(MistakeOf("manipulation", {{limit, bad}}), HasSubstr(limit)) << bad;
    }
    EXPECT_THAT(MistakeOf("manipulation", {{limit, nullptr}}), HasSubstr("is missing"));
  }
  EXPECT_THAT(MistakeOf("manipulation", {{"course_m", 100}}), HasSubstr("not a known key"));
  EXPECT_THAT(MistakeOf("manipulation", {{"force_enforced", 1}}), HasSubstr("true or false"));
  EXPECT_THAT(MistakeOf("manipulation", {{"boards", {{"main", {{"line_successes", 101}}}}}}),
              HasSubstr("boards: main: \"line_successes\" is 101, must be from 1 to 100"));
  EXPECT_THAT(MistakeOf("manipulation", {{"boards", {{"main", {{"band_factor", 0.9}}}}}}),
              HasSubstr("band_factor"));
  EXPECT_THAT(MistakeOf("manipulation", {{"boards", {{"main", {{"ties", "effort"}}}}}}),
              HasSubstr("time, acceptance"));
  EXPECT_THAT(MistakeOf("manipulation", {{"phantom_reason", "dropped"}}),
              HasSubstr("phantom, handover"));
  EXPECT_THAT(MistakeOf("manipulation", {{"boards", {{"second", Json::object()}}}}),
              HasSubstr("boards: \"second\" is not a known key"));
  EXPECT_THAT(MistakeOf("manipulation", {{"boards", 1}}), HasSubstr("must be an object"));
}

TEST(TrackScoring, TellsMistakesOfLocomotion) {
  EXPECT_THAT(MistakeOf("locomotion", {{"team", "any"}}), HasSubstr("best, last, chosen"));
  EXPECT_THAT(MistakeOf("locomotion", {{"time", "wall"}}), HasSubstr("played, reported"));
  EXPECT_THAT(MistakeOf("locomotion", {{"course_m", 0}}), HasSubstr("course_m"));
  EXPECT_THAT(MistakeOf("locomotion", {{"success", "placed"}}), HasSubstr("not a known key"));
  EXPECT_THAT(MistakeOf("locomotion", {{"boards", {{"main", {{"time_from_m", 101}}}}}}),
              HasSubstr("must be from 0 to 100"));
  EXPECT_THAT(MistakeOf("locomotion", {{"boards", {{"main", {{"distance_band", -0.1}}}}}}),
              HasSubstr("distance_band"));
  EXPECT_THAT(MistakeOf("locomotion", {{"boards", {{"physiological", {{"means", "all"}}}}}}),
              HasSubstr("steps, episodes"));
  EXPECT_THAT(MistakeOf("locomotion", {{"boards", {{"physiological", nullptr}}}}),
              HasSubstr("\"physiological\" is missing"));
}

TEST(JudgeEpisode, JudgesByTheRulesOfItsTrackAndProfile) {
  ManipulationFacts arm;
  arm.frames = 500;
  arm.frames_arm = arm.frames_prosthesis = 99;
  arm.solved = arm.goal_only_at_end = true;
  arm.peak_force = 1600;
  arm.reported_time = 4.5;
  EpisodeFacts facts;
  facts.end = ManipulationEnd::kPlaced;
  facts.steps = 500;
  facts.sim_time = 5;
  facts.track = arm;
  const auto judge = [&](const char* profile) {
    return ParseTrackScoring(Load("manipulation", profile))->judge(facts);
  };
  EXPECT_EQ(judge("paper").reason, ManipulationReason::kForce);
  EXPECT_EQ(judge("paper").metrics[ManipulationMetric::kTime], 10);
  EXPECT_EQ(judge("myosuite").reason, ManipulationReason::kHandover);
  EXPECT_EQ(judge("as-graded").outcome, Outcome::kSuccess);
  EXPECT_EQ(judge("as-graded").metrics[ManipulationMetric::kTime], 4.5);

  facts.end = ManipulationEnd::kPhantom;
  facts.track = ManipulationFacts{};
  EXPECT_EQ(judge("as-graded").reason, ManipulationReason::kPhantom);

  LocomotionFacts walk;
  walk.distance = 99.9;
  facts.track = walk;
  facts.end = LocomotionEnd::kFinished;
  const auto walking = ParseTrackScoring(Load("locomotion")).value();
  EXPECT_EQ(walking.judge(facts).outcome, Outcome::kSuccess);
  EXPECT_EQ(walking.judge(facts).metrics[LocomotionMetric::kDistance], 100);
  facts.track = arm;  // facts of another track are the grader's mistake
  EXPECT_EQ(walking.judge(facts).outcome, Outcome::kGraderError);
}

}  // namespace
}  // namespace myograde::server
