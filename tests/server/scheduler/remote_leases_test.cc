// Leases on other hosts: they begin later than they start, and may be lost without a fault.
#include <map>
#include <set>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "server/scheduler/scheduler.h"
#include "tests/server/scheduler/waiting_evaluation.h"

namespace myograde::server {
namespace {

using Kind = Decision::Kind;

constexpr absl::Duration kBegin = absl::ZeroDuration();

EvaluationSpec OfOneTeam(int64_t id, int leases, Priority priority = Priority::kRanked) {
  return WaitingEvaluation(id, "team", leases, priority);
}

SchedulerLimits Remote() {
  return {.slots = 1,
          .begins_later = true,
          .retry_delay = absl::Seconds(2),
          .heartbeat = absl::Seconds(30)};
}

TEST(RemoteLeasesTest, NothingIsDueBeforeALeaseBegins) {
  Scheduler scheduler(Remote());
  scheduler.Add(OfOneTeam(1, 1), kBegin);
  ASSERT_TRUE(scheduler.Next(kBegin));
  scheduler.Heartbeat(1000, 1, absl::Seconds(1));
  EXPECT_TRUE(scheduler.OverdueAt(absl::Hours(100)).empty());
  EXPECT_FALSE(scheduler.NextDeadline(absl::Seconds(1)));
  scheduler.Begun(1000, 1, absl::Hours(1));
  EXPECT_EQ(scheduler.NextDeadline(absl::Hours(1)), absl::Hours(1) + absl::Seconds(30));
  scheduler.Heartbeat(1000, 1, absl::Hours(1) + absl::Seconds(90));
  // It begins once.
  scheduler.Begun(1000, 1, absl::Hours(1) + absl::Seconds(95));
  const auto over = scheduler.OverdueAt(absl::Hours(1) + absl::Seconds(100));
  ASSERT_EQ(over.size(), 1u);
  EXPECT_FALSE(over[0].silent);
}

TEST(RemoteLeasesTest, ASilentOneIsToldFromOneThatIsOverItsTime) {
  Scheduler scheduler(Remote());
  scheduler.Add(OfOneTeam(1, 1), kBegin);
  ASSERT_TRUE(scheduler.Next(kBegin));
  scheduler.Begun(1000, 1, kBegin);
  const auto over = scheduler.OverdueAt(absl::Seconds(30));
  ASSERT_EQ(over.size(), 1u);
  EXPECT_TRUE(over[0].silent);
}

TEST(RemoteLeasesTest, WhatIsLostIsPlayedAgainWithoutAFault) {
  SchedulerLimits limits = Remote();
  limits.max_returns = 12;
  limits.max_retries = 0;
  Scheduler scheduler(limits);
  scheduler.Add(OfOneTeam(1, 2), kBegin);
  absl::Duration now = kBegin;
  absl::Duration delay = absl::Seconds(2);
  for (int64_t attempt = 1; attempt <= 12; ++attempt) {
    const auto start = scheduler.Next(now);
    ASSERT_TRUE(start);
    ASSERT_EQ(start->lease, 1000);
    EXPECT_EQ(start->attempt, attempt);
    const Decision decision = scheduler.Returned(1000, attempt, now);
    EXPECT_EQ(decision.kind, Kind::kRetry);
    EXPECT_FALSE(decision.fault);
    EXPECT_NE(scheduler.WhyWaiting(1, now).find("2 blocks"), std::string::npos);
    scheduler.Free(start->slot);
    EXPECT_EQ(scheduler.NextDeadline(now), now + delay);
    now += delay;
    delay = std::min(2 * delay, Scheduler::kLongestReturn);
  }
  ASSERT_TRUE(scheduler.Next(now));
  const Decision decision = scheduler.Returned(1000, 13, now);
  EXPECT_EQ(decision.kind, Kind::kGiveUp) << "nobody waits for ever";
  EXPECT_TRUE(decision.fault);
  EXPECT_EQ(decision.pending, std::vector<int64_t>{1001});
  EXPECT_EQ(scheduler.Returned(1000, 13, now).kind, Kind::kStale);
}

// Whatever happens, what is due is what a look at every running lease finds due.
RC_GTEST_PROP(RemoteLeasesTest, DeadlinesAreThoseOfEachLease, ()) {
  SchedulerLimits limits = Remote();
  limits.slots = 4;
  limits.begins_later = *rc::gen::arbitrary<bool>();
  limits.max_retries = 1000;
  limits.max_returns = 1000;
  Scheduler scheduler(limits);
  struct Model {
    int64_t attempt = 0;
    int slot = 0;
    absl::Duration silent = absl::InfiniteDuration();
    absl::Duration over = absl::InfiniteDuration();
  };
  std::map<int64_t, Model> running;
  absl::Duration now = kBegin;
  int64_t next_id = 1;
  const auto some = [&] {
    auto it = running.begin();
    std::advance(it, *rc::gen::inRange<size_t>(0, running.size()));
    return it;
  };
  const auto end = [&](auto it, const Decision& decision) {
    RC_ASSERT(decision.kind != Kind::kStale);
    scheduler.Free(it->second.slot);
    running.erase(it);
  };
  const int steps = *rc::gen::inRange(1, 60);
  for (int i = 0; i < steps; ++i) {
    now += absl::Seconds(*rc::gen::inRange(0, 40));
    const int what = *rc::gen::inRange(0, 6);
    if (what == 0 || running.empty()) {
      scheduler.Add(OfOneTeam(next_id++, 3, *rc::gen::element(Priority::kRanked, Priority::kRejudge)), now);
      while (const auto start = scheduler.Next(now)) {
        Model& model = running[start->lease] = {start->attempt, start->slot};
        if (limits.begins_later) continue;
        model.silent = now + absl::Seconds(30);
        model.over = now + absl::Seconds(100);
      }
    } else if (what == 1) {
      auto& [lease, model] = *some();
      scheduler.Begun(lease, model.attempt, now);
      if (model.over == absl::InfiniteDuration()) {
        model.silent = now + absl::Seconds(30);
        model.over = now + absl::Seconds(100);
      }
    } else if (what == 2) {
      auto& [lease, model] = *some();
      scheduler.Heartbeat(lease, model.attempt, now);
      if (model.over != absl::InfiniteDuration()) model.silent = now + absl::Seconds(30);
    } else if (what == 3) {
      const auto it = some();
      end(it, scheduler.Returned(it->first, it->second.attempt, now));
    } else if (what == 4) {
      const auto it = some();
      end(it, scheduler.Finished(it->first, it->second.attempt, now));
    } else if (const auto way = scheduler.Preempt(now)) {
      scheduler.Free(running.at(way->lease).slot);
      running.erase(way->lease);
    }
    std::set<int64_t> due;
    for (const auto& [lease, model] : running) {
      if (std::min(model.silent, model.over) <= now) due.insert(lease);
    }
    std::set<int64_t> found;
    for (const Overdue& late : scheduler.OverdueAt(now)) {
      found.insert(late.lease);
      RC_ASSERT(late.silent == (running.at(late.lease).over > now));
    }
    RC_ASSERT(found == due);
    RC_ASSERT(scheduler.taken_slots() == static_cast<int>(running.size()));
  }
}

}  // namespace
}  // namespace myograde::server
