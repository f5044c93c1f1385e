// Verdicts and metrics of episodes of chase-tag; what is shared is tested with reorientation's.
#include "scoring/chasetag/track.h"

#include <gtest/gtest.h>

namespace myograde::scoring {
namespace chasetag {
namespace {

using At = ChaseTagMetric;

constexpr ChaseTagJudging kRules = {};

// 500 steps: 5 s.
EpisodeFacts Played(bool evades, EpisodeEnd end, bool solved) {
  EpisodeFacts facts;
  facts.end = end;
  facts.steps = 500;
  facts.sim_time = 5.0000000000003;
  facts.track = ChaseTagFacts{.evades = evades,
                              .final_distance = 0.4,
                              .solved = solved,
                              .reported_time = evades || solved ? 5.0 : 20.0,
                              .effort_sum = 25};
  return facts;
}

double ScoreOf(const EpisodeFacts& facts) {
  return Judge(facts, kRules).metrics[At::kScore].value();
}

TEST(ChaseTagJudge, AChaseScoresTheTimeThatATagLeaves) {
  const EpisodeFacts tagged = Played(false, ChaseTagEnd::kTagged, true);
  const Verdict verdict = Judge(tagged, kRules);
  EXPECT_EQ(verdict.outcome, Outcome::kSuccess);
  EXPECT_EQ(verdict.reason, FailureReason::kNone);
  EXPECT_EQ(verdict.metrics[At::kScore], 0.75) << "the time counts to hundredths";
  EXPECT_EQ(verdict.metrics[At::kEffort], 0.05);
  EXPECT_EQ(verdict.metrics[At::kReportedTime], 5);
  EXPECT_EQ(verdict.metrics[At::kFinalDistance], 0.4);
}

TEST(ChaseTagJudge, ALostChaseScoresNothingAndSaysWhy) {
  const std::pair<EpisodeEnd, FailureReason> ends[] = {
      {EpisodeEnd::kTime, FailureReason::kTime},
      {EpisodeEnd::kGivenUp, FailureReason::kGivenUp},
      {ChaseTagEnd::kFell, ChaseTagReason::kFell},
      {ChaseTagEnd::kOutOfBounds, ChaseTagReason::kOutOfBounds}};
  for (const auto& [end, reason] : ends) {
    const Verdict verdict = Judge(Played(false, end, false), kRules);
    EXPECT_EQ(verdict.outcome, Outcome::kFailure) << end.name();
    EXPECT_EQ(verdict.reason, reason);
    EXPECT_EQ(verdict.metrics[At::kScore], 0);
  }
}

TEST(ChaseTagJudge, EvadingScoresItsTimeHoweverItEndedButByGivingUp) {
  EXPECT_EQ(ScoreOf(Played(true, EpisodeEnd::kTime, true)), 0.25);
  EXPECT_EQ(ScoreOf(Played(true, ChaseTagEnd::kCaught, false)), 0.25);
  EXPECT_EQ(ScoreOf(Played(true, ChaseTagEnd::kOutOfBounds, false)), 0.25);
  EXPECT_EQ(ScoreOf(Played(true, EpisodeEnd::kGivenUp, false)), 0);
  EXPECT_EQ(ScoreOf(Played(true, EpisodeEnd::kTime, false)), 0) << "fewer steps than the limit";
  const Verdict caught = Judge(Played(true, ChaseTagEnd::kCaught, false), kRules);
  EXPECT_EQ(caught.outcome, Outcome::kFailure);
  EXPECT_EQ(caught.reason, ChaseTagReason::kCaught);
  EXPECT_EQ(Judge(Played(true, EpisodeEnd::kTime, true), kRules).outcome, Outcome::kSuccess);
}

TEST(ChaseTagJudge, FactsThatContradictThemselvesAreTheGradersFault) {
  EXPECT_EQ(Judge(Played(false, ChaseTagEnd::kTagged, false), kRules).outcome,
            Outcome::kGraderError);
  EXPECT_EQ(Judge(Played(false, ElbowEnd::kHeld, true), kRules).outcome, Outcome::kGraderError);
}

}  // namespace
}  // namespace chasetag
}  // namespace myograde::scoring
