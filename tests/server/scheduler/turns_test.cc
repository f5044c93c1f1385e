// Whose turn it is where several rules meet, and what the views tell of it then.
#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>

#include "server/scheduler/host_health.h"
#include "server/scheduler/scheduler.h"
#include "tests/server/scheduler/waiting_evaluation.h"

namespace myograde::server {
namespace {

constexpr absl::Duration kNow = absl::ZeroDuration();

// Starts the next lease and plays it to its end; returns its evaluation.
int64_t PlayOne(Scheduler& scheduler, absl::Duration now = kNow) {
  const auto start = scheduler.Next(now);
  if (!start.has_value()) return 0;
  scheduler.Finished(start->lease, start->attempt, now);
  scheduler.Free(start->slot);
  return start->evaluation;
}

EvaluationSpec OfParty(int64_t id, const std::string& team, const std::string& submitter) {
  EvaluationSpec spec = WaitingEvaluation(id, team, 1);
  spec.submitter = submitter;
  return spec;
}

TEST(Turns, ATeamThatItsPartyHoldsBackDoesNotHideALaterOne) {
  Scheduler scheduler({.slots = 2});
  scheduler.Add(OfParty(1, "p", "person"), kNow);
  ASSERT_EQ(scheduler.Next(kNow)->evaluation, 1);
  // By itself b would be first; its submitter runs one already, so c is, which came before a.
  scheduler.Add(OfParty(2, "b", "person"), kNow);
  scheduler.Add(WaitingEvaluation(3, "c", 1), kNow);
  scheduler.Add(WaitingEvaluation(4, "a", 1), kNow);
  EXPECT_EQ(scheduler.Next(kNow)->evaluation, 3);
}

TEST(Turns, APartysLastStartCountsForEachOfItsTeams) {
  Scheduler scheduler({.slots = 1});
  scheduler.Add(OfParty(1, "a", "person"), kNow);
  scheduler.Add(OfParty(2, "b", "person"), kNow);
  scheduler.Add(WaitingEvaluation(3, "c", 1), kNow);
  EXPECT_EQ(PlayOne(scheduler), 1);
  EXPECT_EQ(scheduler.PlaceOf(2)->position, 2);
  EXPECT_EQ(PlayOne(scheduler), 3) << "b had no start, its submitter had";
  EXPECT_EQ(PlayOne(scheduler), 2);
}

// How many leases had been played when each evaluation ended, on one slot.
std::map<int64_t, int> EndsOf(Scheduler& scheduler, std::map<int64_t, int> leases) {
  std::map<int64_t, int> ends;
  int played = 0;
  while (const int64_t evaluation = PlayOne(scheduler)) {
    ++played;
    if (--leases[evaluation] == 0) ends[evaluation] = played;
  }
  return ends;
}

// Lease by lease, all would end together at last: at 595 leases in the mean.
TEST(Turns, GoByEvaluationSoThatACrowdWaitsHalfAsLong) {
  constexpr int kTeams = 60;
  constexpr int kLeases = 10;
  Scheduler scheduler({.slots = 1});
  std::map<int64_t, int> leases;
  for (int team = 1; team <= kTeams; ++team) {
    scheduler.Add(WaitingEvaluation(team, absl::StrCat("team ", team), kLeases), kNow);
    leases[team] = kLeases;
  }
  const std::map<int64_t, int> ends = EndsOf(scheduler, leases);
  double sum = 0;
  for (const auto& [id, end] : ends) sum += end;
  ASSERT_EQ(ends.size(), size_t{kTeams});
  EXPECT_LE(sum / kTeams, 0.52 * kTeams * kLeases);
}

// A team with one submission beside one with many, and beside one with a very long one.
TEST(Turns, OfACrowdHoldNobodyUpForLong) {
  Scheduler scheduler({.slots = 1});
  std::map<int64_t, int> leases;
  for (int i = 1; i <= 50; ++i) {
    scheduler.Add(WaitingEvaluation(i, "crowd", 10), kNow);
    leases[i] = 10;
  }
  scheduler.Add(WaitingEvaluation(100, "long", 600), kNow);
  scheduler.Add(WaitingEvaluation(101, "one", 10), kNow);
  leases[100] = 600;
  leases[101] = 10;
  EXPECT_EQ(EndsOf(scheduler, leases)[101], 10 + Scheduler::kLongestTurn + 10);
}

TEST(Turns, AMergedTeamLastStartedWhenEitherOfTheTwoDid) {
  Scheduler scheduler({.slots = 1});
  int64_t id = 0;
  for (const char* team : {"a", "b", "c", "a", "b"}) {
    scheduler.Add(WaitingEvaluation(++id, team, 1), kNow);
  }
  for (const int64_t expected : {1, 2, 3}) ASSERT_EQ(PlayOne(scheduler), expected);
  scheduler.MoveTeam("c", "a");
  EXPECT_EQ(PlayOne(scheduler), 5);
  EXPECT_EQ(PlayOne(scheduler), 4);
}

TEST(Turns, ATeamOfRejudgesHasItsTurnByItsFirstSubmission) {
  Scheduler scheduler({.slots = 1});
  scheduler.Add(WaitingEvaluation(1, "rejudged", 1, Priority::kRejudge), kNow);
  scheduler.Add(WaitingEvaluation(2, "first", 1), kNow);
  scheduler.Add(WaitingEvaluation(3, "second", 1), kNow);
  scheduler.MoveTeam("second", "rejudged");
  EXPECT_EQ(PlayOne(scheduler), 2);
  EXPECT_EQ(PlayOne(scheduler), 3);
}

TEST(Turns, RejudgesOfDifferentTeamsHaveDifferentPlaces) {
  Scheduler scheduler({.slots = 1});
  scheduler.Add(WaitingEvaluation(1, "b", 1, Priority::kRejudge), kNow);
  scheduler.Add(WaitingEvaluation(2, "a", 1, Priority::kRejudge), kNow);
  EXPECT_EQ(scheduler.PlaceOf(2)->position, 1);
  EXPECT_EQ(scheduler.PlaceOf(1)->position, 2);
  EXPECT_EQ(PlayOne(scheduler), 2);
}

TEST(Turns, WhatIsOverdueIsCountedByEverybody) {
  Scheduler scheduler({.slots = 1, .queue_wait = absl::Seconds(60)});
  scheduler.Add(WaitingEvaluation(1, "a", 2, Priority::kPractice), kNow);
  scheduler.Add(WaitingEvaluation(2, "b", 1), absl::Seconds(30));
  EXPECT_EQ(scheduler.PlaceOf(2)->position, 1);
  ASSERT_EQ(scheduler.Escalate(absl::Seconds(60)), std::vector<int64_t>{1});
  EXPECT_EQ(scheduler.DepthAt(absl::Seconds(60)).classes[0].evaluations, 1);
  EXPECT_EQ(scheduler.PlaceOf(2)->position, 2);
  EXPECT_EQ(scheduler.PlaceOf(2)->blocks_ahead, 2);
  EXPECT_EQ(scheduler.QueueOf(nullptr), (std::vector<int64_t>{1, 2}));
}

TEST(Turns, RejudgesArePreemptedForAnOverdueEvaluation) {
  Scheduler scheduler({.slots = 1, .queue_wait = absl::Seconds(60)});
  scheduler.Add(WaitingEvaluation(1, "a", 1, Priority::kRejudge), kNow);
  ASSERT_EQ(scheduler.Next(kNow)->evaluation, 1);
  scheduler.Add(WaitingEvaluation(2, "b", 1), kNow);
  scheduler.Escalate(absl::Seconds(60));
  EXPECT_TRUE(scheduler.Preempt(absl::Seconds(60)).has_value());
}

TEST(Turns, ThreeRejudgesArePreemptedForThreeBlocks) {
  Scheduler scheduler({.slots = 3});
  scheduler.Add(WaitingEvaluation(1, "a", 3, Priority::kRejudge), kNow);
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(scheduler.Next(kNow));
  scheduler.Add(WaitingEvaluation(2, "b", 3), kNow);
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(scheduler.Preempt(kNow)) << i;
  EXPECT_FALSE(scheduler.Preempt(kNow));
}

TEST(Turns, NoMoreRejudgesArePreemptedThanATeamMayRun) {
  Scheduler scheduler({.slots = 2, .team_running = 1});
  scheduler.Add(WaitingEvaluation(1, "a", 2, Priority::kRejudge), kNow);
  for (int i = 0; i < 2; ++i) ASSERT_TRUE(scheduler.Next(kNow));
  scheduler.Add(WaitingEvaluation(2, "b", 2), kNow);
  EXPECT_TRUE(scheduler.Preempt(kNow));
  EXPECT_FALSE(scheduler.Preempt(kNow));
}

// Of an evaluation whose first lease waits for its delay, the second may go at once.
TEST(Turns, ALaterLeaseGoesWhileAnEarlierOneIsDelayed) {
  Scheduler scheduler({.slots = 1, .retry_delay = absl::Seconds(10)});
  scheduler.Add(WaitingEvaluation(1, "a", 2), kNow);
  ASSERT_EQ(scheduler.Next(kNow)->lease, 1000);
  scheduler.Faulted(1000, 1, kNow);
  scheduler.Free(0);
  EXPECT_EQ(scheduler.WhyWaiting(1, kNow), "2 blocks of episodes wait and will start in a moment");
  scheduler.Add(WaitingEvaluation(2, "r", 1, Priority::kRejudge), kNow);
  EXPECT_EQ(scheduler.Next(kNow)->lease, 1001);
}

TEST(Turns, ARejudgeIsPreemptedForABlockBehindADelayedOne) {
  Scheduler scheduler({.slots = 2, .retry_delay = absl::Seconds(10)});
  scheduler.Add(WaitingEvaluation(1, "r", 1, Priority::kRejudge), kNow);
  ASSERT_EQ(scheduler.Next(kNow)->evaluation, 1);
  scheduler.Add(WaitingEvaluation(2, "a", 2), kNow);
  EXPECT_FALSE(scheduler.Preempt(kNow)) << "there is a free slot";
  ASSERT_EQ(scheduler.Next(kNow)->lease, 2000);
  scheduler.Faulted(2000, 1, kNow);
  EXPECT_TRUE(scheduler.Preempt(kNow))
      << "to the second lease; the slot of the first is not free yet";
}

TEST(Turns, ARejudgeIsPreemptedFromTheEndOfADelayOn) {
  Scheduler scheduler({.slots = 1, .retry_delay = absl::Seconds(10)});
  scheduler.Add(WaitingEvaluation(1, "a", 1), kNow);
  ASSERT_EQ(scheduler.Next(kNow)->evaluation, 1);
  scheduler.Faulted(1000, 1, kNow);
  scheduler.Free(0);
  scheduler.Add(WaitingEvaluation(2, "r", 1, Priority::kRejudge), kNow);
  ASSERT_EQ(scheduler.Next(kNow)->evaluation, 2);
  EXPECT_FALSE(scheduler.Preempt(absl::Seconds(9)));
  EXPECT_TRUE(scheduler.Preempt(absl::Seconds(10)));
}

TEST(Waits, BeginAgainWhenALeaseEnds) {
  Scheduler scheduler({.slots = 1, .retry_delay = absl::Seconds(1), .queue_wait = absl::Hours(1)});
  scheduler.Add(WaitingEvaluation(1, "a", 3), kNow);
  ASSERT_TRUE(scheduler.Next(kNow));
  scheduler.Finished(1000, 1, absl::Minutes(50));
  EXPECT_EQ(scheduler.DeadlineOf(1), absl::Minutes(110));
  scheduler.Free(0);
  ASSERT_TRUE(scheduler.Next(absl::Minutes(51)));
  scheduler.Faulted(1001, 1, absl::Minutes(60));
  EXPECT_EQ(scheduler.DeadlineOf(1), absl::Minutes(120));
  EXPECT_TRUE(scheduler.Escalate(absl::Minutes(119)).empty());
  EXPECT_EQ(scheduler.Escalate(absl::Minutes(120)), std::vector<int64_t>{1});
  EXPECT_TRUE(scheduler.Escalate(absl::Minutes(120)).empty()) << "once";
}

TEST(Waits, OfACancelledEvaluationAreForgotten) {
  Scheduler scheduler({.slots = 1, .retry_delay = absl::Seconds(10)});
  scheduler.Add(WaitingEvaluation(1, "a", 1), kNow);
  ASSERT_TRUE(scheduler.Next(kNow));
  scheduler.Faulted(1000, 1, kNow);
  EXPECT_EQ(scheduler.NextDeadline(kNow), absl::Seconds(10));
  scheduler.Cancel(1);
  EXPECT_FALSE(scheduler.NextDeadline(kNow).has_value());
  EXPECT_TRUE(scheduler.Escalate(absl::Hours(10)).empty());
}

TEST(Depth, CountsOnlyWhatWaits) {
  Scheduler scheduler({.slots = 1});
  scheduler.Add(WaitingEvaluation(1, "a", 1), kNow);
  scheduler.Add(WaitingEvaluation(2, "b", 3), kNow);
  ASSERT_EQ(scheduler.Next(kNow)->evaluation, 1);
  const QueueDepth::OfClass ranked =
      scheduler.DepthAt(kNow).classes[static_cast<size_t>(Priority::kRanked)];
  EXPECT_EQ(ranked.evaluations, 1);
  EXPECT_EQ(ranked.blocks, 3);
}

TEST(HostHealth, ATestThatPassesForgetsTheFaultsBeforeIt) {
  HostHealth host({.suspect_after = 2, .test_every = absl::Minutes(3)});
  host.LeaseFaulted(kNow, "x");
  host.LeaseFaulted(kNow, "x");
  host.TestBegins();
  host.TestEnded(kNow, "");
  host.LeaseFaulted(absl::Minutes(4), "x");
  EXPECT_TRUE(host.may_start()) << "one in a row";
  host.LeaseFaulted(absl::Minutes(4), "x");
  EXPECT_FALSE(host.may_start());
}

TEST(HostHealth, TellsTheNextTestInWholeSeconds) {
  HostHealth host({.suspect_after = 1, .test_every = absl::Seconds(10)});
  host.LeaseFaulted(kNow, "x");
  host.TestBegins();
  host.TestEnded(kNow, "no models");
  EXPECT_NE(host.PauseReason(absl::Milliseconds(1500)).find("tested again in 9s"),
            std::string::npos);
}

}  // namespace
}  // namespace myograde::server
