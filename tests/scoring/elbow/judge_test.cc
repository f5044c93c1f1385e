// Verdicts and metrics of elbow episodes.
#include "scoring/elbow/judge.h"

#include <gtest/gtest.h>

namespace myograde::scoring {
namespace elbow {
namespace {

constexpr ElbowJudging kByHolding = {};
constexpr ElbowJudging kByTheFlag = {.success = ElbowSuccess::kSolved,
                                     .time = TimeSource::kReported};

// 40 steps that ended by holding, with the official flag in 30 of them.
EpisodeFacts Held() {
  EpisodeFacts facts;
  facts.end = ElbowEnd::kHeld;
  facts.steps = 40;
  facts.sim_time = 0.8;
  facts.track = ElbowFacts{.held = true,
                           .solved = true,
                           .solved_steps = 30,
                           .effort_sum = 4,
                           .reported_time = 0.8};
  return facts;
}

// 100 steps that the time ended, with the official flag in `solved_steps` of them.
EpisodeFacts TimeUp(int64_t solved_steps) {
  EpisodeFacts facts;
  facts.end = EpisodeEnd::kTime;
  facts.steps = 100;
  facts.sim_time = 2;
  facts.track =
      ElbowFacts{.solved_steps = solved_steps, .effort_sum = 5, .reported_time = 2};
  return facts;
}

TEST(ElbowJudge, HoldingIsASuccessInTheTimeThatItTook) {
  const Verdict verdict = Judge(Held(), kByHolding);
  EXPECT_EQ(verdict.outcome, Outcome::kSuccess);
  EXPECT_EQ(verdict.reason, FailureReason::kNone);
  EXPECT_EQ(verdict.metrics[ElbowMetric::kTime], 0.8);
  EXPECT_EQ(verdict.metrics[ElbowMetric::kEffort], 0.1);
  EXPECT_EQ(verdict.metrics[ElbowMetric::kEffortSum], 4);
  EXPECT_EQ(verdict.steps, 40);
}

TEST(ElbowJudge, TimeThatIsUpIsAFailureThatCountsInFull) {
  ElbowJudging rules = kByHolding;
  rules.full_time_s = 3;
  const Verdict verdict = Judge(TimeUp(100), rules);
  EXPECT_EQ(verdict.outcome, Outcome::kFailure);
  EXPECT_EQ(verdict.reason, FailureReason::kTime);
  EXPECT_EQ(verdict.metrics[ElbowMetric::kTime], 3);
  EXPECT_EQ(verdict.metrics[ElbowMetric::kEffort], 0.05);
}

TEST(ElbowJudge, TheFlagMustBeUpInEnoughSteps) {
  EXPECT_EQ(Judge(TimeUp(5), kByTheFlag).outcome, Outcome::kFailure);
  EXPECT_EQ(Judge(TimeUp(5), kByTheFlag).reason, FailureReason::kTime);
  EXPECT_EQ(Judge(TimeUp(6), kByTheFlag).outcome, Outcome::kSuccess);
  EXPECT_EQ(Judge(TimeUp(6), kByTheFlag).metrics[ElbowMetric::kTime], 2);
  EXPECT_EQ(Judge(Held(), kByTheFlag).metrics[ElbowMetric::kTime], 0.8);
}

TEST(ElbowJudge, AnEpisodeThatWasGivenUpFailsByItUnlessItWasSolved) {
  EpisodeFacts facts = TimeUp(6);
  facts.end = EpisodeEnd::kGivenUp;
  EXPECT_EQ(Judge(facts, kByHolding).reason, FailureReason::kGivenUp);
  EXPECT_EQ(Judge(facts, kByTheFlag).outcome, Outcome::kSuccess);
}

TEST(ElbowJudge, AFaultHasItsOwnOutcomeAndTheFullTime) {
  EpisodeFacts facts = Held();
  facts.end = EpisodeEnd::kFault;
  facts.fault.outcome = Outcome::kStepTimeout;
  for (const ElbowJudging& rules : {kByHolding, kByTheFlag}) {
    const Verdict verdict = Judge(facts, rules);
    EXPECT_EQ(verdict.outcome, Outcome::kStepTimeout);
    EXPECT_EQ(verdict.reason, FailureReason::kNone);
    EXPECT_EQ(verdict.metrics[ElbowMetric::kTime], 2);
  }
}

TEST(ElbowJudge, AFaultBeforeTheFirstStepHasNoEffort) {
  EpisodeFacts facts;
  facts.fault.outcome = Outcome::kInitTimeout;
  const Verdict verdict = Judge(facts, kByHolding);
  EXPECT_EQ(verdict.outcome, Outcome::kInitTimeout);
  EXPECT_EQ(verdict.metrics[ElbowMetric::kEffort], std::nullopt);
}

TEST(ElbowJudge, FactsThatContradictThemselvesAreTheGradersError) {
  EpisodeFacts dropped = Held();
  dropped.end = ManipulationEnd::kDropped;
  EpisodeFacts not_held = TimeUp(100);
  not_held.end = ElbowEnd::kHeld;
  EpisodeFacts of_another_track = Held();
  of_another_track.track = ManipulationFacts{};
  EpisodeFacts played_fault = Held();
  played_fault.end = EpisodeEnd::kFault;
  played_fault.fault.outcome = Outcome::kSuccess;
  for (const EpisodeFacts& facts : {dropped, not_held, of_another_track, played_fault}) {
    EXPECT_EQ(Judge(facts, kByHolding).outcome, Outcome::kGraderError);
  }
}

}  // namespace
}  // namespace elbow
}  // namespace myograde::scoring
