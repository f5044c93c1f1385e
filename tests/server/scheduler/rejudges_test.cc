// Rejudges in the queue: they have what nobody else wants, and give it back at once.
#include <map>
#include <set>
#include <vector>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "server/scheduler/scheduler.h"
#include "tests/server/scheduler/waiting_evaluation.h"

namespace myograde::server {
namespace {

constexpr absl::Duration kStart = absl::ZeroDuration();

EvaluationSpec BlocksOf(int64_t id, const std::string& team, int leases, Priority priority) {
  return WaitingEvaluation(id, team, leases, priority, absl::Hours(100));
}

TEST(RejudgesInTheQueueTest, ComeAfterEverythingElse) {
  Scheduler scheduler({.slots = 1});
  scheduler.Add(BlocksOf(1, "a", 1, Priority::kRejudge), kStart);
  scheduler.Add(BlocksOf(2, "b", 1, Priority::kRerun), kStart);
  EXPECT_EQ(scheduler.PlaceOf(1)->position, 2);
  EXPECT_EQ(scheduler.Next(kStart)->evaluation, 2);
}

TEST(RejudgesInTheQueueTest, NeverBecomeOverdue) {
  Scheduler scheduler({.slots = 1, .queue_wait = absl::Hours(1)});
  scheduler.Add(BlocksOf(1, "a", 1, Priority::kRejudge), kStart);
  EXPECT_FALSE(scheduler.NextDeadline(kStart));
  EXPECT_EQ(scheduler.DeadlineOf(1), absl::InfiniteDuration());
  EXPECT_TRUE(scheduler.Escalate(absl::Hours(1000)).empty());
  scheduler.Add(BlocksOf(2, "b", 1, Priority::kPractice), absl::Hours(1000));
  EXPECT_EQ(scheduler.Next(absl::Hours(1000))->evaluation, 2);
}

TEST(RejudgesInTheQueueTest, ArePreemptedOnceForEachBlockThatIsReady) {
  Scheduler scheduler({.slots = 3});
  scheduler.Add(BlocksOf(1, "a", 3, Priority::kRejudge), kStart);
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(scheduler.Next(kStart));
  EXPECT_FALSE(scheduler.Preempt(kStart)) << "nobody else wants a slot";
  scheduler.Add(BlocksOf(2, "b", 2, Priority::kRanked), kStart);
  EXPECT_FALSE(scheduler.Next(kStart));
  const auto first = scheduler.Preempt(kStart);
  const auto second = scheduler.Preempt(kStart);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->lease, 1002) << "the last to start has the least to lose";
  EXPECT_EQ(first->attempt, 1);
  EXPECT_EQ(second->lease, 1001);
  EXPECT_FALSE(scheduler.Preempt(kStart)) << "two slots become free, and two blocks wait";
  EXPECT_FALSE(scheduler.Next(kStart)) << "their processes may still be there";
  EXPECT_EQ(scheduler.Finished(1002, 1, kStart).kind, Decision::Kind::kStale);
  scheduler.Free(2);
  EXPECT_EQ(scheduler.Next(kStart)->evaluation, 2);
  EXPECT_FALSE(scheduler.Preempt(kStart));
  // A slot whose processes can't be killed is of no use to the lease that waits for it.
  scheduler.Close(1);
  EXPECT_EQ(scheduler.Preempt(kStart)->lease, 1000);
}

TEST(RejudgesInTheQueueTest, WhatGaveWayStartsAgainWithoutAFault) {
  Scheduler scheduler({.slots = 1, .max_retries = 0});
  scheduler.Add(BlocksOf(1, "a", 1, Priority::kRejudge), kStart);
  for (int64_t round = 1; round <= 10; ++round) {
    const auto rejudge = scheduler.Next(kStart);
    ASSERT_TRUE(rejudge);
    ASSERT_EQ(rejudge->lease, 1000);
    EXPECT_EQ(rejudge->attempt, round);
    scheduler.Add(BlocksOf(1 + round, "b", 1, Priority::kRerun), kStart);
    ASSERT_TRUE(scheduler.Preempt(kStart));
    EXPECT_EQ(scheduler.CountWaitingBlocks(1), 1);
    scheduler.Free(rejudge->slot);
    const auto live = scheduler.Next(kStart);
    ASSERT_EQ(live->evaluation, 1 + round);
    scheduler.Finished(live->lease, 1, kStart);
    scheduler.Free(live->slot);
  }
  ASSERT_EQ(scheduler.Next(kStart)->attempt, 11);
  EXPECT_EQ(scheduler.Finished(1000, 11, kStart).kind, Decision::Kind::kEvaluationEnds);
}

TEST(RejudgesInTheQueueTest, AreNotPreemptedForWhatMayNotStart) {
  Scheduler scheduler({.slots = 2, .team_running = 1});
  scheduler.Add(BlocksOf(1, "a", 1, Priority::kRanked), kStart);
  scheduler.Add(BlocksOf(2, "a", 2, Priority::kRejudge), kStart);
  ASSERT_EQ(scheduler.Next(kStart)->evaluation, 1);
  ASSERT_EQ(scheduler.Next(kStart)->evaluation, 2) << "rejudges count in nobody's share";
  scheduler.Add(BlocksOf(3, "a", 1, Priority::kRanked), kStart);
  EXPECT_FALSE(scheduler.Preempt(kStart)) << "the team has as many as it may";
  scheduler.Faulted(1000, 1, kStart);  // to be played again in 2 s
  scheduler.Free(0);
  ASSERT_EQ(scheduler.Next(kStart)->evaluation, 3);
  EXPECT_FALSE(scheduler.Preempt(kStart)) << "it is not ready yet";
}

// A scheduler whose slots are free as soon as a lease is over.
struct Line {
  explicit Line(const SchedulerLimits& limits) : scheduler(limits) {}

  void Fill(absl::Duration now) {
    for (;;) {
      while (const auto start = scheduler.Next(now)) {
        running[start->lease] = {start->attempt, start->slot};
        if (!rejudges.contains(start->evaluation)) live_starts.push_back(start->lease);
      }
      const auto gives_way = scheduler.Preempt(now);
      if (!gives_way) return;
      RC_ASSERT(rejudges.contains(gives_way->evaluation));
      scheduler.Free(running.at(gives_way->lease).second);
      running.erase(gives_way->lease);
    }
  }
  void End(int64_t lease, bool fault, absl::Duration now) {
    const auto [attempt, slot] = running.at(lease);
    running.erase(lease);
    fault ? scheduler.Faulted(lease, attempt, now) : scheduler.Finished(lease, attempt, now);
    scheduler.Free(slot);
  }

  Scheduler scheduler;
  std::set<int64_t> rejudges;
  std::map<int64_t, std::pair<int64_t, int>> running;  // lease to attempt and slot
  std::vector<int64_t> live_starts;
};

// Two schedulers live through the same; one of them has rejudges as well.
RC_GTEST_PROP(RejudgesInTheQueueTest, OthersStartAsIfTheyWereNotThere, ()) {
  const SchedulerLimits limits = {.slots = *rc::gen::inRange(1, 5),
                                  .team_running = *rc::gen::inRange(1, 4),
                                  .max_retries = 1000,
                                  .retry_delay = absl::Seconds(1),
                                  .heartbeat = absl::Hours(100),
                                  .queue_wait = absl::Seconds(20)};
  Line without(limits);
  Line with(limits);
  absl::Duration now = kStart;
  int64_t next_id = 1;
  const auto compare = [&] {
    without.scheduler.Escalate(now);
    with.scheduler.Escalate(now);
    without.Fill(now);
    with.Fill(now);
    RC_ASSERT(with.live_starts == without.live_starts);
  };
  const int steps = *rc::gen::inRange(1, 60);
  for (int i = 0; i < steps; ++i) {
    compare();
    now += absl::Milliseconds(*rc::gen::inRange(0, 3000));
    const int64_t id = next_id++;
    const std::string team(1, static_cast<char>('a' + *rc::gen::inRange(0, 3)));
    const int leases = *rc::gen::inRange(1, 5);
    const int what = *rc::gen::inRange(0, 5);
    if (what == 0) {
      with.rejudges.insert(id);
      with.scheduler.Add(BlocksOf(id, team, leases, Priority::kRejudge), now);
    } else if (what == 1) {
      const EvaluationSpec spec = BlocksOf(
          id, team, leases, *rc::gen::element(Priority::kRanked, Priority::kPractice,
                                              Priority::kRerun));
      without.scheduler.Add(spec, now);
      with.scheduler.Add(spec, now);
    } else if (!with.running.empty()) {
      auto it = with.running.begin();
      std::advance(it, *rc::gen::inRange<size_t>(0, with.running.size()));
      const int64_t lease = it->first;
      with.End(lease, what == 4, now);
      if (without.running.contains(lease)) without.End(lease, what == 4, now);
    }
  }
  for (int round = 0; round < 1000 && with.scheduler.running() + with.scheduler.pending() > 0;
       ++round) {
    now += absl::Seconds(3000);
    compare();
    while (!with.running.empty()) {
      const int64_t lease = with.running.begin()->first;
      with.End(lease, /*fault=*/false, now);
      if (without.running.contains(lease)) without.End(lease, /*fault=*/false, now);
    }
  }
  RC_ASSERT(with.scheduler.pending() == 0);
}

}  // namespace
}  // namespace myograde::server
