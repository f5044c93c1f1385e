// Verdicts and metrics of episodes of relocation; what is shared is tested with reorientation's.
#include "scoring/relocation/track.h"

#include <gtest/gtest.h>

namespace myograde::scoring {
namespace relocation {
namespace {

using At = ScoreMetric;

Verdict Judge(const EpisodeFacts& facts, int64_t solved_steps = 6) {
  const nlohmann::json scoring = {{"solved_steps", solved_steps}, {"team", "best"}};
  return ScoredRelocation().parse(scoring, "scoring")->judge(facts);
}

// 100 steps with the official flag in `solved_steps` of them.
EpisodeFacts Played(EpisodeEnd end, int64_t solved_steps) {
  EpisodeFacts facts;
  facts.end = end;
  facts.steps = 100;
  facts.sim_time = 1;
  facts.track = RelocationFacts{.final_position_error = 0.03,
                                .final_reach = 0.2,
                                .solved_steps = solved_steps,
                                .effort_sum = 5};
  return facts;
}

TEST(RelocationJudge, MoreThanFiveStepsWithTheFlagAreASuccessHoweverItEnded) {
  for (const EpisodeEnd end : {EpisodeEnd(EpisodeEnd::kTime), EpisodeEnd(RelocationEnd::kDropped),
                               EpisodeEnd(EpisodeEnd::kGivenUp)}) {
    const Verdict verdict = Judge(Played(end, 6));
    EXPECT_EQ(verdict.outcome, Outcome::kSuccess) << end.name();
    EXPECT_EQ(verdict.reason, FailureReason::kNone);
    EXPECT_EQ(verdict.metrics[At::kScore], 1);
  }
}

TEST(RelocationJudge, AFailureHasTheReasonOfItsEndAndItsNumbers) {
  const std::pair<EpisodeEnd, FailureReason> ends[] = {
      {EpisodeEnd::kTime, FailureReason::kTime},
      {RelocationEnd::kDropped, RelocationReason::kDropped},
      {EpisodeEnd::kGivenUp, FailureReason::kGivenUp}};
  for (const auto& [end, reason] : ends) {
    const Verdict verdict = Judge(Played(end, 5));
    EXPECT_EQ(verdict.outcome, Outcome::kFailure) << end.name();
    EXPECT_EQ(verdict.reason, reason);
    EXPECT_EQ(verdict.steps, 100);
    EXPECT_EQ(verdict.metrics, (std::vector<std::optional<double>>{0, 0.05, 5, 1, 0.03, 0.2}));
  }
  EXPECT_EQ(Judge(Played(ElbowEnd::kHeld, 6)).outcome, Outcome::kGraderError);
}

}  // namespace
}  // namespace relocation
}  // namespace myograde::scoring
