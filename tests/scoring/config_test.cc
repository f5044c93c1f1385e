// The `scoring` section of track configs, key by key: which values each accepts, and what follows
// from it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "scoring/config.h"
#include "scoring/elbow/judge.h"
#include "scoring/groups.h"
#include "scoring/locomotion/track.h"
#include "scoring/manipulation/track.h"
#include "scoring/statistics_config.h"

namespace myograde::scoring {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;

const json kSections = json::parse(R"json({
  "elbow": {"success": "held", "solved_steps": 6, "time": "played", "full_time_s": 2, "team": "best",
            "boards": {"main": {"line_episodes": 100, "line_successes": 90, "bands": "time",
                                "band_factor": 1.5, "ties": "time"}}},
  "manipulation": {"success": "placed", "contact_frames": 100, "force_enforced": true, "force_limit_n": 1500,
                   "time": "played", "full_time_s": 10, "phantom_reason": "phantom", "team": "best",
                   "boards": {"main": {"line_episodes": 100, "line_successes": 90, "bands": "time",
                                       "band_factor": 1.5, "ties": "time"}}},
  "locomotion": {"time": "played", "full_time_s": 300, "course_m": 100, "team": "best",
                 "boards": {"main": {"time_from_m": 20, "distance_band": 0},
                            "physiological": {"qualify_m": 30, "means": "steps"}}},
  "reorientation": {"solved_steps": 6, "team": "best"},
  "baoding": {"horizon_steps": 200, "solved_steps": 6, "team": "best"},
  "relocation": {"solved_steps": 6, "team": "best"},
  "chasetag": {"full_time_s": 20, "team": "best"}
})json");

absl::StatusOr<TrackScoring> Parsed(const std::string& track, const json& section) {
  return FindScoredTrack(track)->parse(section, track);
}

// The section of the track with another value at a JSON pointer.
absl::StatusOr<TrackScoring> With(const std::string& track, const std::string& at,
                                  const json& value) {
  json section = kSections.at(track);
  section[json::json_pointer(at)] = value;
  return Parsed(track, section);
}

struct Bounds {
  const char* track;
  const char* at;
  json least;
  json most;
  json too_little;
  json too_much;
};

const Bounds kBounds[] = {
    {"elbow", "/solved_steps", 1, 1'000'000, 0, 1'000'001},
    {"reorientation", "/solved_steps", 1, 1'000'000, 0, 1'000'001},
    {"relocation", "/solved_steps", 1, 1'000'000, 0, 1'000'001},
    {"chasetag", "/full_time_s", 1e-3, 1e6, 0.99e-3, 1.01e6},
    {"baoding", "/horizon_steps", 1, 1'000'000, 0, 1'000'001},
    {"baoding", "/solved_steps", 1, 1'000'000, 0, 1'000'001},
    {"elbow", "/full_time_s", 1e-3, 1e6, 0.99e-3, 1.01e6},
    {"elbow", "/boards/main/line_episodes", 90, 10'000, 0, 10'001},
    {"elbow", "/boards/main/line_successes", 1, 100, 0, 101},
    {"elbow", "/boards/main/band_factor", 1, 10, 0.99, 10.01},
    {"manipulation", "/contact_frames", 1, 1'000'000, 0, 1'000'001},
    {"manipulation", "/force_limit_n", 1e-3, 1e9, 0.99e-3, 1.01e9},
    {"manipulation", "/full_time_s", 1e-3, 1e6, 0.99e-3, 1.01e6},
    {"locomotion", "/full_time_s", 1e-3, 1e6, 0.99e-3, 1.01e6},
    {"locomotion", "/course_m", 30, 1e6, 0, 1.01e6},
    {"locomotion", "/boards/main/time_from_m", 0, 100, -0.01, 100.01},
    {"locomotion", "/boards/main/distance_band", 0, 9, -0.01, 9.01},
    {"locomotion", "/boards/physiological/qualify_m", 0, 100, -0.01, 100.01},
};

TEST(ScoringConfig, AcceptsNumbersUpToTheirBounds) {
  for (const Bounds& bounds : kBounds) {
    SCOPED_TRACE(std::string(bounds.track) + bounds.at);
    const std::string at = bounds.at;
    const std::string key = at.substr(at.rfind('/') + 1);
    EXPECT_TRUE(With(bounds.track, at, bounds.least).ok())
        << With(bounds.track, at, bounds.least).status();
    EXPECT_TRUE(With(bounds.track, at, bounds.most).ok())
        << With(bounds.track, at, bounds.most).status();
    for (const json& bad : {bounds.too_little, bounds.too_much, json("1")}) {
      EXPECT_THAT(std::string(With(bounds.track, at, bad).status().message()), HasSubstr(key))
          << bad;
    }
  }
}

TEST(ScoringConfig, AcceptsTheShortestCourse) {
  json section = kSections.at("locomotion");
  section["course_m"] = 1e-3;
  section["boards"]["main"]["time_from_m"] = 0;
  section["boards"]["physiological"]["qualify_m"] = 1e-3;
  EXPECT_TRUE(Parsed("locomotion", section).ok());
  section["boards"]["physiological"]["qualify_m"] = 0;
  section["course_m"] = 0.99e-3;
  EXPECT_FALSE(Parsed("locomotion", section).ok());
}

TEST(ScoringConfig, AcceptsALineOfOneEpisode) {
  json section = kSections.at("elbow");
  section["boards"]["main"]["line_episodes"] = section["boards"]["main"]["line_successes"] = 1;
  EXPECT_TRUE(Parsed("elbow", section).ok());
}

TEST(ScoringConfig, HasNoOptionalKeyAndNoOtherOnes) {
  for (const auto& [track, whole] : kSections.items()) {
    EXPECT_TRUE(Parsed(track, whole).ok());
    const json flat = whole.flatten();
    for (const auto& [place, value] : flat.items()) {
      SCOPED_TRACE(track + place);
      const json::json_pointer at(place);
      json section = whole;
      section[at.parent_pointer()].erase(at.back());
      EXPECT_THAT(std::string(Parsed(track, section).status().message()),
                  testing::AllOf(HasSubstr(at.back()), HasSubstr("is missing")));
      section = whole;
      section[at.parent_pointer()]["further"] = 1;
      EXPECT_THAT(std::string(Parsed(track, section).status().message()),
                  HasSubstr("\"further\" is not a known key"));
      section = whole;
      section[at] = json::array();
      EXPECT_FALSE(Parsed(track, section).ok());
    }
    if (!whole.contains("boards")) continue;
    EXPECT_THAT(std::string(With(track, "/boards/further", 1).status().message()),
                HasSubstr("\"further\" is not a known key"));
  }
}

TEST(ScoringConfig, SaysWhichSubmissionATeamStandsWith) {
  for (const auto& [track, section] : kSections.items()) {
    EXPECT_EQ(With(track, "/team", "best")->team, TeamRule::kBest);
    EXPECT_EQ(With(track, "/team", "last")->team, TeamRule::kLast);
    EXPECT_EQ(With(track, "/team", "chosen")->team, TeamRule::kChosen);
    EXPECT_EQ(Parsed(track, section)->track, FindScoredTrack(track));
    if (!section.contains("time")) continue;
    EXPECT_FALSE(With(track, "/time", "played")->official_figures);
    EXPECT_TRUE(With(track, "/time", "reported")->official_figures);
  }
}

TEST(ScoringConfig, TieredBoardsHaveTheirLineBandsAndTies) {
  for (const char* track : {"elbow", "manipulation"}) {
    const auto rules = [&](const char* at, const json& value) {
      return std::get<TieredBoard>(With(track, at, value)->boards.at(kMainBoard).rules);
    };
    const TieredBoard board = rules("/boards/main/line_successes", 80);
    EXPECT_EQ(board.line_successes, 80);
    EXPECT_EQ(board.line_episodes, 100);
    EXPECT_EQ(board.bands, BandsOver::kTime);
    EXPECT_EQ(board.band_factor, 1.5);
    EXPECT_EQ(board.ties, Ties::kTime);
    EXPECT_EQ(board.time, 0u);
    EXPECT_EQ(board.effort, 1u);
    EXPECT_EQ(rules("/boards/main/bands", "success").bands, BandsOver::kSuccess);
    EXPECT_EQ(rules("/boards/main/ties", "acceptance").ties, Ties::kAcceptance);
  }
}

TEST(ScoringConfig, TieredBoardsRankByTheTracksPlaces) {
  const json section = {{"boards", kSections["elbow"]["boards"]}};
  ConfigReader reader(section, "section");
  const absl::StatusOr<TieredBoard> board = FinishWithTieredBoard(reader, /*time=*/3, /*effort=*/2);
  ASSERT_TRUE(board.ok()) << board.status();
  EXPECT_EQ(board->time, 3u);
  EXPECT_EQ(board->effort, 2u);
}

TEST(ScoringConfig, BoardsOfLocomotionHaveTheirNumbers) {
  const auto board = [](const char* at, const json& value, const char* name) {
    return With("locomotion", at, value)->boards.at(name).rules;
  };
  const auto distance = std::get<DistanceBoard>(board("/boards/main/distance_band", 0.25, "main"));
  EXPECT_EQ(distance.time_from_m, 20);
  EXPECT_EQ(distance.band, 0.25);
  EXPECT_EQ(distance.distance, 0u);
  EXPECT_EQ(distance.time, 1u);
  const auto steps =
      std::get<PhysiologicalBoard>(board("/boards/physiological/means", "steps", "physiological"));
  EXPECT_EQ(steps.means, MeansOver::kSteps);
  EXPECT_EQ(steps.qualify_m, 30);
  EXPECT_EQ(steps.distance, 0u);
  EXPECT_EQ(steps.effort, 4u);
  EXPECT_EQ(steps.pain, 5u);
  const auto episodes = std::get<PhysiologicalBoard>(
      board("/boards/physiological/means", "episodes", "physiological"));
  EXPECT_EQ(episodes.means, MeansOver::kEpisodes);
  EXPECT_EQ(episodes.effort, 2u);
  EXPECT_EQ(episodes.pain, 3u);
}

// The names of the metrics that a board shows.
std::vector<std::string> ColumnsOf(const TrackScoring& scoring, const char* board) {
  std::vector<std::string> names;
  for (const size_t column : scoring.boards.at(board).columns) {
    names.emplace_back(scoring.track->metrics[column].name);
  }
  return names;
}

TEST(ScoringConfig, BoardsShowWhatTheyRankBy) {
  EXPECT_THAT(ColumnsOf(*Parsed("elbow", kSections["elbow"]), "main"),
              ElementsAre("time_s", "effort"));
  EXPECT_THAT(ColumnsOf(*Parsed("reorientation", kSections["reorientation"]), "main"),
              ElementsAre("effort"));
  EXPECT_THAT(ColumnsOf(*Parsed("baoding", kSections["baoding"]), "main"),
              ElementsAre("score", "effort"));
  EXPECT_THAT(ColumnsOf(*Parsed("manipulation", kSections["manipulation"]), "main"),
              ElementsAre("time_s", "effort"));
  EXPECT_THAT(ColumnsOf(*With("manipulation", "/time", "reported"), "main"),
              ElementsAre("time_s", "effort", "max_touch_n"));
  EXPECT_THAT(ColumnsOf(*Parsed("locomotion", kSections["locomotion"]), "main"),
              ElementsAre("distance_m", "time_s", "effort", "pain"));
  EXPECT_THAT(ColumnsOf(*Parsed("locomotion", kSections["locomotion"]), "physiological"),
              ElementsAre("distance_m", "time_s", "effort_over_steps", "pain_over_steps"));
  EXPECT_THAT(
      ColumnsOf(*With("locomotion", "/boards/physiological/means", "episodes"), "physiological"),
      ElementsAre("distance_m", "time_s", "effort", "pain"));
}

TEST(ScoringConfig, JudgesElbowsByItsNumbers) {
  EpisodeFacts facts;
  facts.end = EpisodeEnd::kTime;
  facts.steps = 10;
  facts.sim_time = 1.5;
  facts.track = ElbowFacts{.solved_steps = 7, .effort_sum = 5, .reported_time = 1.25};
  const auto judged = [&](const char* at, const json& value) {
    return With("elbow", at, value)->judge(facts);
  };
  EXPECT_EQ(judged("/success", "held").outcome, Outcome::kFailure);
  EXPECT_EQ(judged("/success", "held").metrics[ElbowMetric::kTime], 2);
  EXPECT_EQ(judged("/full_time_s", 3).metrics[ElbowMetric::kTime], 3);
  EXPECT_EQ(judged("/success", "solved").outcome, Outcome::kSuccess);
  EXPECT_EQ(judged("/success", "solved").metrics[ElbowMetric::kTime], 1.5);
  EXPECT_EQ(judged("/time", "reported").metrics[ElbowMetric::kTime], 1.25);
  json strict = kSections["elbow"];
  strict["success"] = "solved";
  strict["solved_steps"] = 8;
  EXPECT_EQ(Parsed("elbow", strict)->judge(facts).outcome, Outcome::kFailure);
}

TEST(ScoringConfig, JudgesManipulationByItsNumbers) {
  const auto rules = [](const char* at, const json& value) {
    json section = kSections["manipulation"];
    section[json::json_pointer(at)] = value;
    ConfigReader reader(section, "manipulation");
    return ReadManipulationJudging(reader);
  };
  EXPECT_EQ(rules("/success", "placed").success, SuccessRule::kPlaced);
  EXPECT_EQ(rules("/success", "solved").success, SuccessRule::kSolved);
  EXPECT_EQ(rules("/success", "solved-and-contact").success, SuccessRule::kSolvedAndContact);
  EXPECT_EQ(rules("/contact_frames", 7).contact_frames, 7);
  EXPECT_TRUE(rules("/force_enforced", true).force_enforced);
  EXPECT_FALSE(rules("/force_enforced", false).force_enforced);
  EXPECT_EQ(rules("/force_limit_n", 7.5).force_limit_n, 7.5);
  EXPECT_EQ(rules("/time", "played").time, TimeSource::kPlayed);
  EXPECT_EQ(rules("/time", "reported").time, TimeSource::kReported);
  EXPECT_EQ(rules("/full_time_s", 7.5).full_time_s, 7.5);
  EXPECT_EQ(rules("/phantom_reason", "phantom").phantom, ManipulationReason::kPhantom);
  EXPECT_EQ(rules("/phantom_reason", "handover").phantom, ManipulationReason::kHandover);
  EpisodeFacts facts;
  facts.end = ManipulationEnd::kPhantom;
  facts.track = ManipulationFacts{};
  EXPECT_EQ(With("manipulation", "/phantom_reason", "handover")->judge(facts).reason,
            ManipulationReason::kHandover);
}

TEST(ScoringConfig, JudgesLocomotionByItsNumbers) {
  EpisodeFacts facts;
  facts.end = LocomotionEnd::kFinished;
  facts.steps = 10;
  facts.sim_time = 40;
  facts.track = LocomotionFacts{.distance = 99, .reported_time = 41};
  const auto metric = [&](const char* at, const json& value, size_t place) {
    return With("locomotion", at, value)->judge(facts).metrics[place];
  };
  EXPECT_EQ(metric("/course_m", 120, LocomotionMetric::kDistance), 120);
  EXPECT_EQ(metric("/time", "played", LocomotionMetric::kTime), 40);
  EXPECT_EQ(metric("/time", "reported", LocomotionMetric::kTime), 41);
  facts.end = EpisodeEnd::kFault;
  EXPECT_EQ(metric("/full_time_s", 250, LocomotionMetric::kTime), 250);
}

std::string RankedNames(const ScoredTrack& track) {
  std::string names;
  for (const Metric& metric : track.metrics) {
    if (metric.ranked) names += (names.empty() ? "" : ",") + std::string(metric.name);
  }
  return names;
}

TEST(ScoredTracks, RankByTheirNumbersInOrder) {
  EXPECT_EQ(RankedNames(*FindScoredTrack("elbow")), "time_s,effort");
  EXPECT_EQ(RankedNames(*FindScoredTrack("manipulation")), "time_s,effort");
  EXPECT_EQ(RankedNames(*FindScoredTrack("reorientation")), "score,effort");
  EXPECT_EQ(RankedNames(*FindScoredTrack("baoding")), "score,effort");
  EXPECT_EQ(RankedNames(*FindScoredTrack("relocation")), "score,effort");
  EXPECT_EQ(RankedNames(*FindScoredTrack("chasetag")), "score,effort");
  EXPECT_EQ(RankedNames(*FindScoredTrack("locomotion")),
            "distance_m,time_s,effort,pain,effort_over_steps,pain_over_steps");
  EXPECT_EQ(FindScoredTrack("elbows"), nullptr);
  // One that is not ranked does not end the list.
  constexpr Metric kThreeMetrics[] = {{.name = "a", .title = "", .unit = "", .ranked = true},
                                      {.name = "b", .title = "", .unit = ""},
                                      {.name = "c", .title = "", .unit = "", .ranked = true}};
  EXPECT_EQ(RankedPlace(kThreeMetrics, 0), 0u);
  EXPECT_EQ(RankedPlace(kThreeMetrics, 2), 1u);
  EXPECT_EQ(&MetricOf(kThreeMetrics, 0), &kThreeMetrics[0]);
  EXPECT_EQ(&MetricOf(kThreeMetrics, 1), &kThreeMetrics[2]);
}

TEST(ScoredTracks, SayHowManyDigitsPeopleSee) {
  const auto digits = [](const char* track) {
    std::vector<int> all;
    for (const Metric& metric : FindScoredTrack(track)->metrics) all.push_back(metric.digits);
    return all;
  };
  EXPECT_THAT(digits("elbow"), ElementsAre(4, 6, 4, 4, 4));
  EXPECT_THAT(digits("reorientation"), ElementsAre(4, 6, 4, 4, 4, 4));
  EXPECT_THAT(digits("baoding"), ElementsAre(4, 6, 4, 4, 4));
  EXPECT_THAT(digits("relocation"), ElementsAre(4, 6, 4, 4, 4, 4));
  EXPECT_THAT(digits("chasetag"), ElementsAre(4, 6, 4, 4, 4, 4));
  EXPECT_THAT(digits("manipulation"), ElementsAre(4, 6, 4, 4, 1, 1, 6));
  EXPECT_THAT(digits("locomotion"), ElementsAre(4, 4, 6, 6, 4, 4, 4, 6, 6));
}

// Results of a track have always had these keys.
TEST(ScoredTracks, KeepTheKeysOfEarlierResults) {
  EXPECT_THAT(FindScoredTrack("elbow")->null_metrics, testing::IsEmpty());
  EXPECT_THAT(FindScoredTrack("locomotion")->null_metrics, ElementsAre("peak_force_n"));
  EXPECT_THAT(FindScoredTrack("locomotion")->null_means,
              ElementsAre("peak_force_n", "max_touch_n"));
  EXPECT_THAT(FindScoredTrack("locomotion")->null_spreads, testing::IsEmpty());
  EXPECT_THAT(FindScoredTrack("manipulation")->null_metrics,
              ElementsAre("pain", "distance_m", "pain_sum"));
  EXPECT_THAT(FindScoredTrack("manipulation")->null_means,
              ElementsAre("pain", "distance_m", "pain_sum", "pain_over_steps"));
  EXPECT_THAT(FindScoredTrack("manipulation")->null_spreads, ElementsAre("pain", "distance_m"));
}

absl::StatusOr<StatisticsConfig> Statistics(const json& section,
                                            const StatisticsConfig& fallback = {}) {
  return ParseStatistics(section, "statistics", fallback);
}

TEST(StatisticsConfig, KeepsWhatIsUsualWhereNothingIsSaid) {
  const StatisticsConfig fallback{.groups = {.level = 0.25, .samples = 777, .places = 3},
                               .ranks = StatisticsConfig::Ranks::kGroups};
  const StatisticsConfig got = *Statistics(json::object(), fallback);
  EXPECT_EQ(got.groups, fallback.groups);
  EXPECT_EQ(got.ranks, fallback.ranks);
  const json written = {{"method", "paired-permutation"},
                        {"level", 0.25},
                        {"samples", 777},
                        {"places", 3},
                        {"ranks", "groups"}};
  EXPECT_EQ(StatisticsToJson(got), written);
  EXPECT_EQ(StatisticsToJson(*Statistics(written)), written);
  EXPECT_EQ(StatisticsToJson(*Statistics({{"ranks", "rules"}}, fallback))["ranks"], "rules");
}

TEST(StatisticsConfig, AcceptsNumbersUpToTheirBounds) {
  const json widest = {{"level", 0.5}, {"samples", kMostSamples}, {"places", kMostTestedPlaces}};
  EXPECT_TRUE(Statistics(widest).ok());
  for (const auto& [key, bad] :
       std::vector<std::pair<std::string, json>>{{"level", 0.51},
                                                 {"level", 0.99e-4},
                                                 {"samples", kMostSamples + 1},
                                                 {"samples", 0},
                                                 {"places", kMostTestedPlaces + 1},
                                                 {"places", 1},
                                                 {"method", "t"},
                                                 {"ranks", "luck"},
                                                 {"further", 1}}) {
    json section = widest;
    section[key] = bad;
    EXPECT_THAT(std::string(Statistics(section).status().message()), HasSubstr(key)) << section;
  }
  EXPECT_TRUE(Statistics({{"level", 1e-4}, {"samples", 10'000}, {"places", 2}}).ok());
  EXPECT_FALSE(Statistics({{"level", 0.99e-4}, {"samples", 100'000}, {"places", 2}}).ok());
  // One test at the level 1/2 can decide with two samples, not with one.
  EXPECT_TRUE(Statistics({{"level", 0.5}, {"samples", 2}, {"places", 2}}).ok());
  EXPECT_THAT(
      std::string(Statistics({{"level", 0.5}, {"samples", 1}, {"places", 2}}).status().message()),
      HasSubstr("no test could decide anything below 2"));
}

}  // namespace
}  // namespace myograde::scoring
