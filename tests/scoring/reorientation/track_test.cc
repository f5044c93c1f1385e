// Verdicts and metrics of episodes of die reorientation.
#include "scoring/reorientation/track.h"

#include <gtest/gtest.h>

namespace myograde::scoring {
namespace reorientation {
namespace {

using At = ScoreMetric;

Verdict Judge(const EpisodeFacts& facts, int64_t solved_steps = 6) {
  const nlohmann::json scoring = {{"solved_steps", solved_steps}, {"team", "best"}};
  return ScoredReorientation().parse(scoring, "scoring")->judge(facts);
}

// 100 steps with the official flag in `solved_steps` of them.
EpisodeFacts Played(EpisodeEnd end, int64_t solved_steps) {
  EpisodeFacts facts;
  facts.end = end;
  facts.steps = 100;
  facts.sim_time = 1;
  facts.track = ReorientationFacts{.final_position_error = 0.03,
                                   .final_rotation_error = 2,
                                   .solved_steps = solved_steps,
                                   .effort_sum = 5};
  return facts;
}

TEST(ReorientationJudge, MoreThanFiveStepsWithTheFlagAreASuccessHoweverItEnded) {
  for (const EpisodeEnd end :
       {EpisodeEnd(EpisodeEnd::kTime), EpisodeEnd(ReorientationEnd::kDropped),
        EpisodeEnd(EpisodeEnd::kGivenUp)}) {
    const Verdict verdict = Judge(Played(end, 6));
    EXPECT_EQ(verdict.outcome, Outcome::kSuccess) << end.name();
    EXPECT_EQ(verdict.reason, FailureReason::kNone);
    EXPECT_EQ(verdict.metrics[At::kScore], 1);
  }
}

TEST(ReorientationJudge, AFailureHasTheReasonOfItsEndAndItsNumbers) {
  const std::pair<EpisodeEnd, FailureReason> ends[] = {
      {EpisodeEnd::kTime, FailureReason::kTime},
      {ReorientationEnd::kDropped, ReorientationReason::kDropped},
      {EpisodeEnd::kGivenUp, FailureReason::kGivenUp}};
  for (const auto& [end, reason] : ends) {
    const Verdict verdict = Judge(Played(end, 5));
    EXPECT_EQ(verdict.outcome, Outcome::kFailure) << end.name();
    EXPECT_EQ(verdict.reason, reason);
    EXPECT_EQ(verdict.steps, 100);
    EXPECT_EQ(verdict.metrics, (std::vector<std::optional<double>>{0, 0.05, 5, 1, 0.03, 2}));
  }
  EXPECT_EQ(Judge(Played(EpisodeEnd::kTime, 5), 5).outcome, Outcome::kSuccess);
}

TEST(ReorientationJudge, AFaultHasItsOwnOutcomeAndNoScore) {
  EpisodeFacts facts = Played(EpisodeEnd::kFault, 50);
  facts.fault.outcome = Outcome::kStepTimeout;
  EXPECT_EQ(Judge(facts).outcome, Outcome::kStepTimeout);
  EXPECT_EQ(Judge(facts).metrics[At::kScore], 0);
  EpisodeFacts unplayed;
  unplayed.fault.outcome = Outcome::kInitTimeout;
  EXPECT_EQ(Judge(unplayed).outcome, Outcome::kInitTimeout);
  EXPECT_EQ(Judge(unplayed).metrics[At::kEffort], std::nullopt);
}

TEST(ReorientationJudge, FactsThatContradictThemselvesAreTheGradersError) {
  EpisodeFacts of_another_track = Played(EpisodeEnd::kTime, 6);
  of_another_track.track = ElbowFacts{};
  EpisodeFacts played_fault = Played(EpisodeEnd::kFault, 6);
  played_fault.fault.outcome = Outcome::kSuccess;
  for (const EpisodeFacts& facts :
       {Played(ElbowEnd::kHeld, 6), of_another_track, played_fault}) {
    EXPECT_EQ(Judge(facts).outcome, Outcome::kGraderError);
  }
}

}  // namespace
}  // namespace reorientation
}  // namespace myograde::scoring
