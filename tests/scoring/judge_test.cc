#include "scoring/elbow/judge.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "protocol/base/config_reader.h"
#include "protocol/tracks/registry.h"
#include "scoring/locomotion/judge.h"
#include "scoring/manipulation/judge.h"

namespace myograde::scoring {
namespace {

using nlohmann::json;

EpisodeFacts FactsOf(const json& j, bool manipulation) {
  EpisodeFacts facts;
  facts.end = ParseEpisodeEnd(j.at("end").get<std::string>()).value();
  facts.fault.outcome = ParseOutcome(j.value("fault", "grader_error")).value();
  facts.steps = j.at("steps");
  facts.sim_time = j.at("sim_time");
  if (manipulation) {
    ManipulationFacts m;
    m.frames_arm = j.at("frames_arm");
    m.frames_prosthesis = j.at("frames_prosthesis");
    m.frames_other = j.at("frames_other");
    m.peak_force = j.at("peak_force");
    m.solved = j.at("solved");
    m.goal_only_at_end = j.at("goal_only_at_end");
    m.effort_sum = j.at("effort_sum");
    m.reported_time = j.at("reported_time");
    facts.track = m;
  } else {
    LocomotionFacts l;
    l.distance = j.at("distance");
    l.effort_sum = j.at("effort_sum");
    l.pain_sum = j.at("pain_sum");
    l.reported_time = j.at("reported_time");
    facts.track = l;
  }
  return facts;
}

Verdict JudgeBy(const json& rules, const EpisodeFacts& facts, bool manipulation) {
  const TimeSource time =
      rules.at("time") == "played" ? TimeSource::kPlayed : TimeSource::kReported;
  if (!manipulation) return Judge(facts, LocomotionJudging{.time = time});
  const std::string success = rules.at("success");
  ManipulationJudging judging;
  judging.success = success == "placed"   ? SuccessRule::kPlaced
                    : success == "solved" ? SuccessRule::kSolved
                                          : SuccessRule::kSolvedAndContact;
  judging.force_enforced = rules.at("force_enforced");
  judging.time = time;
  judging.phantom = ParseFailureReason(rules.value("phantom", "phantom")).value();
  return Judge(facts, judging);
}

// Every case of every file in judge/: a new one needs no change here.
TEST(Judge, AgreesWithTheTables) {
  int cases = 0;
  for (const auto& file :
       std::filesystem::directory_iterator(MYOGRADE_SOURCE_DIR "/tests/scoring/judge")) {
    const auto table = ReadJsonFile(file.path().string());
    ASSERT_TRUE(table.ok()) << table.status();
    const bool manipulation = table->at("track") == "manipulation";
    for (const json& expected : table->at("cases")) {
      SCOPED_TRACE(file.path().filename().string() + ": " +
                   expected.at("about").get<std::string>());
      const EpisodeFacts facts = FactsOf(expected.at("facts"), manipulation);
      const Verdict got = JudgeBy(table->at("rules"), facts, manipulation);
      EXPECT_EQ(OutcomeName(got.outcome), expected.at("outcome").get<std::string>());
      EXPECT_EQ(got.reason.name(), expected.at("reason").get<std::string>());
      if (expected.contains("time")) {
        const size_t time =
            manipulation ? size_t{ManipulationMetric::kTime} : size_t{LocomotionMetric::kTime};
        EXPECT_EQ(got.metrics[time], expected["time"].get<double>());
      }
      if (expected.contains("distance")) {
        EXPECT_EQ(got.metrics[LocomotionMetric::kDistance], expected["distance"].get<double>());
      }
      ++cases;
    }
  }
  EXPECT_GE(cases, 30);
}

TEST(Judge, AFaultBeforeTheFirstStepHasNeitherEffortNorPain) {
  EpisodeFacts facts;  // as the runner writes it: no facts of the track at all
  facts.fault.outcome = Outcome::kInitTimeout;
  const Verdict got = Judge(facts, LocomotionJudging{});
  EXPECT_EQ(got.outcome, Outcome::kInitTimeout);
  EXPECT_FALSE(got.metrics[LocomotionMetric::kEffort].has_value());
  EXPECT_FALSE(got.metrics[LocomotionMetric::kPain].has_value());
  EXPECT_EQ(got.metrics[LocomotionMetric::kTime], 300);
  EXPECT_EQ(got.metrics[LocomotionMetric::kDistance], 0);
}

TEST(Judge, MeansOverStepsNeedAStep) {
  EXPECT_EQ(MeanOverSteps(6, 1), 6);
  EXPECT_EQ(MeanOverSteps(6, 3), 2);
  EXPECT_EQ(MeanOverSteps(6, 0), std::nullopt);
  EXPECT_EQ(MeanOverSteps(6, -1), std::nullopt);
}

TEST(Judge, KeepsWhatWasMeasured) {
  EpisodeFacts facts;
  facts.end = EpisodeEnd::kTime;
  facts.steps = 4;
  facts.sim_time = 8;
  facts.track = LocomotionFacts{.distance = 50, .effort_sum = 2, .pain_sum = 6, .reported_time = 9};
  const Verdict walk = Judge(facts, LocomotionJudging{});
  EXPECT_EQ(walk.steps, 4);
  EXPECT_EQ(walk.metrics, (std::vector<std::optional<double>>{50, 8, 0.5, 1.5, 2, 6, 9, {}, {}}));
  facts.track = ManipulationFacts{};
  auto& arm = std::get<ManipulationFacts>(facts.track);
  arm.effort_sum = 2;
  arm.reported_time = 9;
  arm.peak_force = 5;
  arm.max_touch = 3;
  const Verdict grip = Judge(facts, ManipulationJudging{.full_time_s = 7});
  EXPECT_EQ(grip.steps, 4);
  EXPECT_EQ(grip.metrics, (std::vector<std::optional<double>>{7, 0.5, 2, 9, 5, 3, {}}));
  facts.track = ElbowFacts{.final_error = 0.5, .effort_sum = 2, .reported_time = 9};
  const Verdict elbow = Judge(facts, ElbowJudging{.full_time_s = 7});
  EXPECT_EQ(elbow.steps, 4);
  EXPECT_EQ(elbow.metrics, (std::vector<std::optional<double>>{7, 0.5, 2, 9, 0.5}));
}

// Distances before the start and beyond the course count as its ends.
TEST(Judge, ADistanceIsOnTheCourse) {
  EpisodeFacts facts;
  facts.end = LocomotionEnd::kFell;
  for (const auto& [walked, counted] :
       std::vector<std::pair<double, double>>{{-1, 0}, {30, 30}, {101, 100}}) {
    facts.track = LocomotionFacts{.distance = walked};
    EXPECT_EQ(Judge(facts, LocomotionJudging{}).metrics[LocomotionMetric::kDistance], counted);
  }
}

// Every end of a track, and some that are none of it.
TEST(Judge, TakesOnlyTheEndsOfItsTrack) {
  EpisodeFacts facts;
  facts.track = LocomotionFacts{};
  for (const EpisodeEnd end : {EpisodeEnd(ManipulationEnd::kPlaced), EpisodeEnd(ElbowEnd::kHeld)}) {
    facts.end = end;
    EXPECT_EQ(Judge(facts, LocomotionJudging{}).outcome, Outcome::kGraderError);
    EXPECT_TRUE(Judge(facts, LocomotionJudging{}).metrics.empty());
  }
  facts.track = ManipulationFacts{};
  for (const EpisodeEnd end : {EpisodeEnd(LocomotionEnd::kFell), EpisodeEnd(ElbowEnd::kHeld)}) {
    facts.end = end;
    EXPECT_EQ(Judge(facts, ManipulationJudging{}).outcome, Outcome::kGraderError);
    EXPECT_TRUE(Judge(facts, ManipulationJudging{}).metrics.empty());
  }
  // Facts of another track are none.
  facts.end = EpisodeEnd::kTime;
  EXPECT_EQ(Judge(facts, LocomotionJudging{}).outcome, Outcome::kGraderError);
  EXPECT_EQ(Judge(facts, ElbowJudging{}).outcome, Outcome::kGraderError);
  facts.track = LocomotionFacts{};
  EXPECT_EQ(Judge(facts, ManipulationJudging{}).outcome, Outcome::kGraderError);
}

}  // namespace
}  // namespace myograde::scoring
