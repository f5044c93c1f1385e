#include <filesystem>

#include <gtest/gtest.h>

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

Judgement JudgeBy(const json& rules, const EpisodeFacts& facts, bool manipulation) {
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
      const Judgement got = JudgeBy(table->at("rules"), facts, manipulation);
      EXPECT_EQ(OutcomeName(got.outcome), expected.at("outcome").get<std::string>());
      EXPECT_EQ(got.reason.name(), expected.at("reason").get<std::string>());
      if (expected.contains("time")) {
        const size_t time = manipulation ? size_t{ManipulationMetric::kTime}
                                         : size_t{LocomotionMetric::kTime};
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
  const Judgement got = Judge(facts, LocomotionJudging{});
  EXPECT_EQ(got.outcome, Outcome::kInitTimeout);
  EXPECT_FALSE(got.metrics[LocomotionMetric::kEffort].has_value());
  EXPECT_FALSE(got.metrics[LocomotionMetric::kPain].has_value());
  EXPECT_EQ(got.metrics[LocomotionMetric::kTime], 300);
  EXPECT_EQ(got.metrics[LocomotionMetric::kDistance], 0);
}

}  // namespace
}  // namespace myograde::scoring
