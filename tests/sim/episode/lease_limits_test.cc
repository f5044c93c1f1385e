// Budgets, caps and the grader's own faults.
#include "tests/sim/episode/lease_world.h"

namespace myograde::sim {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST_F(LeasePlayerTest, SilenceAtTheStartIsAnInitTimeout) {
  order_.episodes.resize(1);
  order_.track.budgets.startup_wall_s = 1.2;
  const LeaseResult silent = Play({[](Sandbox& sandbox) { sandbox.Hear(); }});
  EXPECT_THAT(Outcomes(silent), ElementsAre(Outcome::kInitTimeout));
  EXPECT_EQ(silent.episodes[0].fault.limit, "startup_wall_s");
  EXPECT_GT(silent.episodes[0].fault.value, 1.2);
  EXPECT_GE(silent.progress, 2);  // the runner hears from us while we wait
  // A hello alone is not enough.
  const LeaseResult half = Play({[](Sandbox& sandbox) {
    sandbox.Hello();
    while (sandbox.Hear() != nullptr) {
    }
  }});
  EXPECT_THAT(Outcomes(half), ElementsAre(Outcome::kInitTimeout));
}

TEST_F(LeasePlayerTest, AStartMayTakeItsProcessorTimeAndItsIdleTimeTogether) {
  order_.episodes.resize(1);
  order_.track.budgets.startup_s = 0.2;
  const auto uses = [this](double cpu_s, double idle_s) {
    return [=, this](Sandbox& sandbox) {
      std::this_thread::sleep_for(std::chrono::milliseconds(500));
      EXPECT_EQ(cpu_.waits, 0u) << "that idling is another's";
      // As the runner does, while the simulator says that it waits.
      while (cpu_.starts % 2 == 0) std::this_thread::yield();
      cpu_.cpu_ns += static_cast<uint64_t>(1e9 * cpu_s);
      cpu_.start_idle_ns += static_cast<uint64_t>(1e9 * idle_s);
      sandbox.PlayWell();
    };
  };
  // Half a second of wall time: a busy host's.
  EXPECT_THAT(Outcomes(Play({uses(0.09, 0.09)})), ElementsAre(Outcome::kFailure));
  for (const auto& [cpu_s, idle_s] : {std::pair(0.12, 0.12), {0.3, 0.0}, {0.0, 0.3}}) {
    cpu_.waits = 0;
    const LeaseResult over = Play({uses(cpu_s, idle_s)});
    EXPECT_THAT(Outcomes(over), ElementsAre(Outcome::kInitTimeout));
    EXPECT_EQ(over.episodes[0].fault.limit, "startup_s");
    EXPECT_NEAR(over.episodes[0].fault.value, cpu_s + idle_s, 1e-9);
  }
  // Two processors for a fifth of a second are no half second.
  order_.track.budgets.startup_s = 3;
  cpu_.waits = 0;
  EXPECT_THAT(Outcomes(Play({uses(4, 0)})), ElementsAre(Outcome::kFailure));
}

TEST_F(LeasePlayerTest, CpuTimeBeyondTheBankIsAStepTimeout) {
  order_.episodes.resize(1);
  const LeaseResult result = Play({[this](Sandbox& sandbox) {
    sandbox.Hello();
    while (const PublishFrame* question = sandbox.Hear()) {
      // Each step takes 21 s of CPU time, 20 of them from the bank of 60.
      if (question->expect == Expect::kAction) cpu_.cpu_ns += 21'000'000'000u;
      sandbox.Answer(*question);
    }
  }});
  EXPECT_THAT(Outcomes(result), ElementsAre(Outcome::kStepTimeout));
  EXPECT_EQ(result.episodes[0].steps, 3);
  EXPECT_EQ(result.episodes[0].fault.limit, "step_s");
  EXPECT_EQ(result.episodes[0].fault.value, 21);
}

TEST_F(LeasePlayerTest, CpuTimeIsReadAnewForAnAnswerThatTookItsTime) {
  order_.episodes.resize(1);
  const LeaseResult result = Play({[this](Sandbox& sandbox) {
    sandbox.Hello();
    while (const PublishFrame* question = sandbox.Hear()) {
      if (question->expect == Expect::kAction && question->step == 2) {
        read_when_asked_ = 90'000'000'000u;  // a step has 1 s and a bank of 60
        std::this_thread::sleep_for(std::chrono::milliseconds(15));
      }
      sandbox.Answer(*question);
    }
  }});
  EXPECT_THAT(Outcomes(result), ElementsAre(Outcome::kStepTimeout));
  EXPECT_EQ(result.episodes[0].steps, 2);
  EXPECT_EQ(result.episodes[0].fault.value, 90);
  EXPECT_GE(result.readings, 1);
}

TEST_F(LeasePlayerTest, ASleeperMeetsTheWallCap) {
  order_.episodes.resize(1);
  order_.track.budgets.step_s = 0.1;
  order_.track.budgets.overtime_s = 0.1;
  order_.track.budgets.wall_factor = 2;
  const LeaseResult result = Play({[](Sandbox& sandbox) {
    ASSERT_TRUE(sandbox.PlayUntil(0, 2));
    sandbox.Hear();
  }});
  EXPECT_THAT(Outcomes(result), ElementsAre(Outcome::kStepTimeout));
  EXPECT_EQ(result.episodes[0].fault.limit, "wall_factor");
  EXPECT_EQ(result.episodes[0].steps, 2);
}

TEST_F(LeasePlayerTest, TheBankIsFilledForEachEpisode) {
  const LeaseResult result = Play({[this](Sandbox& sandbox) {
    sandbox.Hello();
    while (const PublishFrame* question = sandbox.Hear()) {
      if (question->expect == Expect::kAction && question->step == 0) {
        cpu_.cpu_ns += 50'000'000'000u;
      }
      sandbox.Answer(*question);
    }
  }});
  EXPECT_THAT(Outcomes(result),
              ElementsAre(Outcome::kFailure, Outcome::kFailure, Outcome::kFailure));
  EXPECT_EQ(result.episodes[1].policy_cpu_s, 50);
}

TEST_F(LeasePlayerTest, TheStartIsToldApartFromTheFirstEpisode) {
  const LeaseResult result = Play({[this](Sandbox& sandbox) {
    cpu_.cpu_ns += 7'000'000'000u;
    sandbox.Hello();
    bool ready = false;
    while (const PublishFrame* question = sandbox.Hear()) {
      if (question->expect == Expect::kReady) {
        cpu_.cpu_ns += ready ? 3'000'000'000u : 2'000'000'000u;  // `reset` of the first is the start's
        ready = true;
      }
      sandbox.Answer(*question);
    }
  }});
  ASSERT_GE(result.episodes.size(), 2u);
  EXPECT_EQ(result.episodes[0].policy_cpu_s, 0);
  EXPECT_EQ(result.episodes[1].policy_cpu_s, 3);
}

TEST_F(LeasePlayerTest, TheLeasesCapsEndTheWholeLease) {
  order_.track.budgets.lease_cpu_s = 30;
  const LeaseResult result = Play({[this](Sandbox& sandbox) {
    sandbox.Hello();
    while (const PublishFrame* question = sandbox.Hear()) {
      if (question->expect == Expect::kAction) cpu_.cpu_ns += 4'000'000'000u;
      sandbox.Answer(*question);
    }
  }});
  EXPECT_THAT(Outcomes(result),
              ElementsAre(Outcome::kFailure, Outcome::kCpuLimit, Outcome::kCpuLimit));
  EXPECT_EQ(result.sandboxes, 1);
}

TEST_F(LeasePlayerTest, IdlingIsCountedWhileAnAnswerIsWaitedForAndEndsTheLease) {
  order_.track.budgets.lease_idle_s = 12;
  const LeaseResult result = Play({[this](Sandbox& sandbox) {
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    EXPECT_EQ(cpu_.waits, 0u) << "start-up has its own limit";
    sandbox.Hello();
    while (const PublishFrame* question = sandbox.Hear()) {
      if (question->expect == Expect::kAction) {
        // As the runner does, once the simulator says that it waits.
        while (cpu_.waits % 2 == 0) std::this_thread::yield();
        cpu_.idle_ns += 5'000'000'000u;
      }
      sandbox.Answer(*question);
    }
  }});
  EXPECT_THAT(Outcomes(result), ElementsAre(Outcome::kWallTimeout, Outcome::kWallTimeout,
                                            Outcome::kWallTimeout));
  EXPECT_EQ(result.episodes[0].fault.limit, "lease_idle_s");
  EXPECT_EQ(result.episodes[0].fault.limit_value, 12);
  EXPECT_DOUBLE_EQ(result.episodes[0].fault.value, 15);
  EXPECT_EQ(result.episodes[0].steps, 2);
  EXPECT_EQ(result.sandboxes, 1);
}

TEST_F(LeasePlayerTest, BadNumbersAreThePolicysButItsProcessGoesOn) {
  environment_.unstable_at = 3;
  const LeaseResult result = Play({[](Sandbox& sandbox) { sandbox.PlayWell(); }});
  ASSERT_TRUE(result.status.ok()) << result.status;
  EXPECT_THAT(Outcomes(result),
              ElementsAre(Outcome::kUnstable, Outcome::kUnstable, Outcome::kUnstable));
  EXPECT_EQ(result.sandboxes, 1);
  EXPECT_EQ(result.episodes[0].steps, 3);
  EXPECT_EQ(std::get<ManipulationFacts>(result.episodes[0].track).effort_sum, 0);
}

TEST_F(LeasePlayerTest, AnOverflowIsTheGraders) {
  environment_.overflow_at = 2;
  const LeaseResult result = Play({[](Sandbox& sandbox) { sandbox.PlayWell(); }});
  EXPECT_TRUE(absl::IsInternal(result.status)) << result.status;
  EXPECT_THAT(std::string(result.status.message()), HasSubstr("step 1 of episode 10"));
  EXPECT_TRUE(result.episodes.empty());
}

TEST_F(LeasePlayerTest, ARunnerThatIsGoneEndsTheLease) {
  auto [here, there] = Pair();
  there.reset();
  LeasePlayer player(order_, environment_, 1000, here.get(), &cpu_, SystemClock());
  EXPECT_TRUE(absl::IsUnavailable(player.Play()));
}

}  // namespace
}  // namespace myograde::sim
