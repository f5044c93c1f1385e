// Verdicts and metrics of episodes of Baoding balls.
#include "scoring/baoding/track.h"

#include <gtest/gtest.h>

namespace myograde::scoring {
namespace baoding {
namespace {

using At = BaodingMetric;

constexpr BaodingJudging kRules = {};

// 100 steps with the official flag in `solved_steps` of them.
EpisodeFacts Played(EpisodeEnd end, int64_t solved_steps) {
  EpisodeFacts facts;
  facts.end = end;
  facts.steps = 100;
  facts.sim_time = 2.5;
  facts.track = BaodingFacts{.distance_sum = 3, .solved_steps = solved_steps, .effort_sum = 5};
  return facts;
}

TEST(BaodingJudge, TheScoreIsTheShareOfTheHorizonSoADropCostsWhatIsLeft) {
  const std::pair<EpisodeEnd, FailureReason> ends[] = {
      {EpisodeEnd::kTime, FailureReason::kTime},
      {BaodingEnd::kDropped, BaodingReason::kDropped},
      {EpisodeEnd::kGivenUp, FailureReason::kGivenUp}};
  for (const auto& [end, reason] : ends) {
    const Verdict good = Judge(Played(end, 50), kRules);
    EXPECT_EQ(good.outcome, Outcome::kSuccess) << end.name();
    EXPECT_EQ(good.reason, FailureReason::kNone);
    EXPECT_EQ(good.steps, 100);
    EXPECT_EQ(good.metrics, (std::vector<std::optional<double>>{0.25, 0.05, 5, 2.5, 0.03}));
    const Verdict bad = Judge(Played(end, 5), kRules);
    EXPECT_EQ(bad.outcome, Outcome::kFailure) << end.name();
    EXPECT_EQ(bad.reason, reason);
    EXPECT_EQ(bad.metrics[At::kScore], 0.025) << "a failure has its share too";
  }
  EXPECT_EQ(Judge(Played(EpisodeEnd::kTime, 50), BaodingJudging{.horizon_steps = 100})
                .metrics[At::kScore],
            0.5);
  EXPECT_EQ(Judge(Played(EpisodeEnd::kTime, 5), BaodingJudging{.solved_steps = 5}).outcome,
            Outcome::kSuccess);
}

TEST(BaodingJudge, AFaultHasItsOwnOutcomeAndNoScore) {
  EpisodeFacts facts = Played(EpisodeEnd::kFault, 50);
  facts.fault.outcome = Outcome::kStepTimeout;
  EXPECT_EQ(Judge(facts, kRules).outcome, Outcome::kStepTimeout);
  EXPECT_EQ(Judge(facts, kRules).metrics[At::kScore], 0);
  EpisodeFacts unplayed;
  unplayed.fault.outcome = Outcome::kInitTimeout;
  EXPECT_EQ(Judge(unplayed, kRules).outcome, Outcome::kInitTimeout);
  EXPECT_EQ(Judge(unplayed, kRules).metrics[At::kEffort], std::nullopt);
  EXPECT_EQ(Judge(unplayed, kRules).metrics[At::kDistance], std::nullopt);
}

TEST(BaodingJudge, FactsThatContradictThemselvesAreTheGradersError) {
  EpisodeFacts of_another_track = Played(EpisodeEnd::kTime, 6);
  of_another_track.track = ElbowFacts{};
  EpisodeFacts played_fault = Played(EpisodeEnd::kFault, 6);
  played_fault.fault.outcome = Outcome::kSuccess;
  for (const EpisodeFacts& facts : {Played(ElbowEnd::kHeld, 6), of_another_track, played_fault}) {
    EXPECT_EQ(Judge(facts, kRules).outcome, Outcome::kGraderError);
  }
}

}  // namespace
}  // namespace baoding
}  // namespace myograde::scoring
