// What the scheduler says of itself, word for word, and the edges of its numbers.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "server/scheduler/host_health.h"
#include "server/scheduler/scheduler.h"
#include "tests/server/scheduler/waiting_evaluation.h"

namespace myograde::server {
namespace {

using Kind = Decision::Kind;

constexpr absl::Duration kZero = absl::ZeroDuration();
constexpr absl::Duration kOneSecond = absl::Seconds(1);

TEST(WhyWaiting, SaysWhatALeaseWaitsFor) {
  Scheduler scheduler({.slots = 2, .team_running = 1, .queue_wait = absl::Hours(1)});
  EXPECT_EQ(scheduler.WhyWaiting(1, kZero), "") << "unknown";
  scheduler.Add(WaitingEvaluation(1, "a", 2), kZero);
  EXPECT_EQ(scheduler.WhyWaiting(1, kZero), "2 blocks of episodes wait and will start in a moment");
  ASSERT_EQ(scheduler.Next(kZero)->lease, 1000);
  EXPECT_EQ(scheduler.WhyWaiting(1, kZero),
            "1 block of episodes waits until another of the team ends: 1 runs, which is as many as "
            "one team "
            "may have");
  scheduler.Add(WaitingEvaluation(2, "b", 1), kZero);
  EXPECT_EQ(scheduler.WhyWaiting(2, kZero), "1 block of episodes waits and will start in a moment");
  ASSERT_EQ(scheduler.Next(kZero)->lease, 2000);
  EXPECT_EQ(scheduler.WhyWaiting(2, kZero), "") << "nothing of it waits";
  scheduler.Add(WaitingEvaluation(3, "c", 1), kZero);
  scheduler.Add(WaitingEvaluation(4, "c", 1), kZero);
  EXPECT_EQ(scheduler.WhyWaiting(3, kZero),
            "1 block of episodes waits for a slot: 2 of 2 are taken, and 0 blocks of episodes of "
            "others or of earlier "
            "submissions ahead");
  EXPECT_EQ(scheduler.WhyWaiting(4, kZero),
            "1 block of episodes waits for a slot: 2 of 2 are taken, and 2 blocks of episodes of "
            "others or of earlier "
            "submissions ahead");
  scheduler.Escalate(absl::Hours(1));
  EXPECT_EQ(scheduler.WhyWaiting(3, absl::Hours(1)),
            "1 block of episodes waits for a slot: 2 of 2 are taken, and 0 blocks of episodes of "
            "others or of earlier "
            "submissions ahead; it "
            "has waited for more than 1h and goes ahead of all that has not");
}

TEST(WhyWaiting, CountsWhatRunsOfTheTeamAndOneSlot) {
  Scheduler scheduler({.slots = 3, .team_running = 2});
  scheduler.Add(WaitingEvaluation(1, "a", 3), kZero);
  ASSERT_TRUE(scheduler.Next(kZero) && scheduler.Next(kZero));
  EXPECT_EQ(scheduler.WhyWaiting(1, kZero),
            "1 block of episodes waits until another of the team ends: 2 run, which is as many as "
            "one team may have");
  Scheduler one({.slots = 1});
  one.Add(WaitingEvaluation(1, "a", 2), kZero);
  ASSERT_TRUE(one.Next(kZero));
  EXPECT_EQ(one.WhyWaiting(1, kZero),
            "1 block of episodes waits for a slot: 1 of 1 is taken, and 0 blocks of episodes of "
            "others or of earlier "
            "submissions ahead");
}

TEST(WhyWaiting, SaysWhenALeaseIsPlayedAgain) {
  Scheduler scheduler({.slots = 1, .max_retries = 3, .retry_delay = absl::Seconds(2)});
  scheduler.Add(WaitingEvaluation(1, "a", 1), kZero);
  ASSERT_TRUE(scheduler.Next(kZero));
  ASSERT_EQ(scheduler.Returned(1000, 1, kZero).kind, Kind::kRetry);
  EXPECT_EQ(scheduler.WhyWaiting(1, absl::Milliseconds(500)),
            "1 block of episodes waits to be played again after their place was lost, in 2s");
  scheduler.Free(0);
  EXPECT_FALSE(scheduler.Next(absl::Milliseconds(1999)));
  EXPECT_EQ(scheduler.WhyWaiting(1, 2 * kOneSecond),
            "1 block of episodes waits and will start in a moment");
  ASSERT_TRUE(scheduler.Next(2 * kOneSecond));
  ASSERT_EQ(scheduler.Faulted(1000, 2, 2 * kOneSecond).kind, Kind::kRetry);
  EXPECT_EQ(scheduler.WhyWaiting(1, 3 * kOneSecond),
            "1 block of episodes waits to be played again after a fault of the grader, in 1s");
}

TEST(Depth, HasTheLongestWaitSinceTheLastStart) {
  Scheduler scheduler({.slots = 1});
  scheduler.Add(WaitingEvaluation(1, "a", 2), absl::Seconds(10));
  EXPECT_EQ(scheduler.DepthAt(absl::Seconds(5)).oldest, kZero) << "never less than nothing";
  scheduler.Add(WaitingEvaluation(2, "b", 1), absl::Seconds(12));
  EXPECT_EQ(scheduler.DepthAt(absl::Seconds(20)).oldest, absl::Seconds(10));
  ASSERT_EQ(scheduler.Next(absl::Seconds(20))->evaluation, 1);
  EXPECT_EQ(scheduler.DepthAt(absl::Seconds(22)).oldest, absl::Seconds(10)) << "the other one";
  scheduler.Cancel(2);
  EXPECT_EQ(scheduler.DepthAt(absl::Seconds(22)).oldest, absl::Seconds(2));
  EXPECT_EQ(scheduler.DepthAt(absl::Seconds(22)).classes[1].evaluations, 1);
  EXPECT_EQ(scheduler.DepthAt(absl::Seconds(22)).classes[1].blocks, 1);
  EXPECT_EQ(scheduler.CountWaitingBlocks(1), 1);
  EXPECT_EQ(scheduler.CountWaitingBlocks(2), 0);
}

TEST(Deadlines, OfAnEvaluationAreItsWaitAndThoseOfItsLeases) {
  Scheduler scheduler(
      {.slots = 2, .heartbeat = absl::Seconds(30), .queue_wait = absl::Seconds(60)});
  EXPECT_FALSE(scheduler.DeadlineOf(1));
  scheduler.Add(WaitingEvaluation(1, "a", 2), kZero);
  EXPECT_EQ(scheduler.DeadlineOf(1), absl::Seconds(60));
  ASSERT_TRUE(scheduler.Next(absl::Seconds(5)));
  EXPECT_EQ(scheduler.DeadlineOf(1), absl::Seconds(35)) << "silence";
  scheduler.Heartbeat(1000, 1, absl::Seconds(80));
  EXPECT_EQ(scheduler.DeadlineOf(1), absl::Seconds(65))
      << "the wait of the other, since the last start";
  ASSERT_TRUE(scheduler.Next(absl::Seconds(90)));
  scheduler.Heartbeat(1001, 1, absl::Seconds(100));
  EXPECT_EQ(scheduler.DeadlineOf(1), absl::Seconds(105)) << "the cap of the first";
  const std::vector<Overdue> late = scheduler.OverdueAt(absl::Seconds(130));
  ASSERT_EQ(late.size(), 2u);
  EXPECT_EQ(late[0].lease, 1000);
  EXPECT_FALSE(late[0].silent);
  EXPECT_EQ(late[0].why, "the runner kept the lease beyond its wall-clock cap");
  EXPECT_EQ(late[1].lease, 1001);
  EXPECT_TRUE(late[1].silent);
  EXPECT_EQ(late[1].why, "the lease was not renewed: its runner was silent for 30s");
}

// What a store remembers of a lease counts on.
TEST(Retries, GoOnFromEarlierAttemptsAndFaults) {
  Scheduler scheduler({.slots = 1, .max_retries = 3, .retry_delay = absl::Seconds(2)});
  EvaluationSpec spec = WaitingEvaluation(1, "a", 1);
  spec.blocks[0].attempt = 5;
  spec.blocks[0].faults = 2;
  scheduler.Add(spec, kZero);
  EXPECT_EQ(scheduler.Next(kZero)->attempt, 6);
  EXPECT_EQ(scheduler.Faulted(1000, 6, kZero).kind, Kind::kRetry);
  EXPECT_EQ(scheduler.NextDeadline(kZero), absl::Seconds(8)) << "the third delay";
  scheduler.Free(0);
  ASSERT_EQ(scheduler.Next(absl::Seconds(8))->attempt, 7);
  const Decision last = scheduler.Faulted(1000, 7, absl::Seconds(8));
  EXPECT_EQ(last.kind, Kind::kGiveUp);
  EXPECT_TRUE(last.fault);
  EXPECT_EQ(last.evaluation, 1);
}

TEST(Retries, DelaysAreDoubledTwentyTimesAtMost) {
  for (const auto& [faults, doublings] :
       std::vector<std::pair<int64_t, int>>{{0, 0}, {19, 19}, {20, 20}, {21, 20}, {60, 20}}) {
    Scheduler scheduler({.slots = 1,
                         .max_retries = 100,
                         .retry_delay = kOneSecond,
                         .queue_wait = absl::InfiniteDuration()});
    EvaluationSpec spec = WaitingEvaluation(1, "a", 1);
    spec.blocks[0].faults = faults;
    scheduler.Add(spec, kZero);
    ASSERT_TRUE(scheduler.Next(kZero));
    scheduler.Faulted(1000, 1, kZero);
    EXPECT_EQ(scheduler.NextDeadline(kZero), kOneSecond * (int64_t{1} << doublings)) << faults;
  }
}

TEST(Slots, AreTakenAndFreedByTheirNumbers) {
  Scheduler scheduler({.slots = 2});
  EXPECT_EQ(scheduler.TakeSlot(), 0);
  EXPECT_EQ(scheduler.TakeSlot(), 1);
  EXPECT_EQ(scheduler.TakeSlot(), std::nullopt);
  EXPECT_EQ(scheduler.taken_slots(), 2);
  scheduler.Free(2);
  EXPECT_EQ(scheduler.TakeSlot(), std::nullopt) << "there is no third one";
  scheduler.Free(1);
  scheduler.Free(0);
  EXPECT_EQ(scheduler.TakeSlot(), 0);
  scheduler.Close(1);
  EXPECT_EQ(scheduler.TakeSlot(), std::nullopt);
}

// The first evaluation to start, with one slot.
int64_t FirstOf(Scheduler& scheduler) { return scheduler.Next(kZero)->evaluation; }

TEST(Teams, ThatBecomeOneKeepTheEarlierTurn) {
  Scheduler earlier({.slots = 1});
  earlier.Add(WaitingEvaluation(1, "a", 1), kZero);
  earlier.Add(WaitingEvaluation(2, "b", 1), kZero);
  earlier.Add(WaitingEvaluation(3, "c", 1), kZero);
  earlier.MoveTeam("a", "c");
  EXPECT_EQ(FirstOf(earlier), 1) << "it came before b";

  Scheduler later({.slots = 1});
  later.Add(WaitingEvaluation(1, "a", 1), kZero);
  later.Add(WaitingEvaluation(2, "b", 1), kZero);
  later.Add(WaitingEvaluation(3, "c", 1), kZero);
  later.Cancel(1);
  later.MoveTeam("c", "a");
  EXPECT_EQ(FirstOf(later), 3) << "as a came before b";

  // A team that had rejudges only has no turn to bring, and takes that of the other.
  Scheduler rejudged({.slots = 1});
  rejudged.Add(WaitingEvaluation(1, "r", 1, Priority::kRejudge), kZero);
  rejudged.Add(WaitingEvaluation(2, "b", 1), kZero);
  rejudged.Add(WaitingEvaluation(3, "c", 1), kZero);
  rejudged.MoveTeam("r", "c");
  EXPECT_EQ(FirstOf(rejudged), 2);
  Scheduler taken({.slots = 1});
  taken.Add(WaitingEvaluation(1, "r", 1, Priority::kRejudge), kZero);
  taken.Add(WaitingEvaluation(2, "c", 1), kZero);
  taken.Add(WaitingEvaluation(3, "b", 1), kZero);
  taken.MoveTeam("c", "r");
  EXPECT_EQ(FirstOf(taken), 2);
}

TEST(Teams, OfRejudgesComeInTheOrderOfTheirNames) {
  Scheduler scheduler({.slots = 1});
  scheduler.Add(WaitingEvaluation(1, "b", 1, Priority::kRejudge), kZero);
  scheduler.Add(WaitingEvaluation(2, "a", 1, Priority::kRejudge), kZero);
  EXPECT_EQ(FirstOf(scheduler), 2);
}

TEST(TeamLine, CountsByClassAndAge) {
  TeamLine line;
  EXPECT_EQ(line.BlocksOfFirst(Priority::kRanked, 5), 0);
  line.Set(Priority::kRanked, 7, 3);
  line.Set(Priority::kRanked, 4, 2);
  line.Set(Priority::kPractice, 5, 9);
  EXPECT_EQ(line.size(Priority::kRanked), 2);
  EXPECT_EQ(line.RankOf(Priority::kRanked, 4), 0);
  EXPECT_EQ(line.RankOf(Priority::kRanked, 7), 1);
  EXPECT_EQ(line.RankOf(Priority::kRanked, 8), 2);
  EXPECT_EQ(line.BlocksOfFirst(Priority::kRanked, 0), 0);
  EXPECT_EQ(line.BlocksOfFirst(Priority::kRanked, 1), 2);
  EXPECT_EQ(line.BlocksOfFirst(Priority::kRanked, 2), 5);
  EXPECT_EQ(line.BlocksOfFirst(Priority::kRanked, 3), 5);
  line.Set(Priority::kRanked, 4, 0);
  EXPECT_EQ(line.size(Priority::kRanked), 1);
  EXPECT_EQ(line.RankOf(Priority::kRanked, 7), 0);
  EXPECT_EQ(line.BlocksOfFirst(Priority::kRanked, 1), 3);
  line.Set(Priority::kRanked, 7, 1);
  EXPECT_EQ(line.BlocksOfFirst(Priority::kRanked, 1), 1);
}

TEST(HostHealth, SaysWhyNothingStarts) {
  HostHealth host({.suspect_after = 1, .test_every = absl::Minutes(3)});
  EXPECT_EQ(host.PauseReason(kZero), "");
  EXPECT_FALSE(host.NextTest());
  host.LeaseFaulted(kZero, "no disk");
  EXPECT_EQ(host.PauseReason(kZero),
            "the host is being tested after 1 fault of the grader in a row, the last one: no disk");
  EXPECT_FALSE(host.NextTest()) << "it is due already";
  host.TestBegins();
  host.TestEnded(kOneSecond, "no models");
  EXPECT_EQ(host.paused_since(), kOneSecond);
  EXPECT_EQ(host.NextTest(), absl::Seconds(181));
  EXPECT_EQ(host.PauseReason(absl::Milliseconds(1500)),
            "the host is paused, as its self-test failed: no models; it is tested again in 3m, and "
            "goes on by itself "
            "once it passes");
  EXPECT_EQ(host.PauseReason(absl::Seconds(200)),
            "the host is paused, as its self-test failed: no models; it is tested again in 0, and "
            "goes on by itself "
            "once it passes");
  host.TestBegins();
  EXPECT_FALSE(host.NextTest());
  EXPECT_EQ(host.PauseReason(absl::Seconds(200)),
            "the host is paused, as its self-test failed: no models; it is being tested again now, "
            "and goes on by "
            "itself once it passes");
  host.TestEnded(absl::Seconds(200), "");
  // The faults before the test are forgotten, and it is not tested again before its time.
  host.LeaseFaulted(absl::Seconds(379), "x");
  EXPECT_TRUE(host.may_start());
  host.LeaseFaulted(absl::Seconds(380), "x");
  EXPECT_FALSE(host.may_start());
}

TEST(Names, AreThoseOfTheirValues) {
  EXPECT_EQ(PriorityName(Priority::kOverdue), "overdue");
  EXPECT_EQ(PriorityName(Priority::kRanked), "ranked");
  EXPECT_EQ(PriorityName(Priority::kPractice), "practice");
  EXPECT_EQ(PriorityName(Priority::kRerun), "rerun");
  EXPECT_EQ(PriorityName(Priority::kRejudge), "rejudge");
  EXPECT_EQ(HostStateName(HostHealth::State::kWell), "well");
  EXPECT_EQ(HostStateName(HostHealth::State::kSuspected), "suspected");
  EXPECT_EQ(HostStateName(HostHealth::State::kPaused), "paused");
}

}  // namespace
}  // namespace myograde::server
