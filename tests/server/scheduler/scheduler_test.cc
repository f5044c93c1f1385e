// The scheduler against random histories: submissions, ends, faults, silences, cancels and late
// events in any order.
#include "server/scheduler/scheduler.h"

#include <ctime>
#include <map>
#include <set>

#include <absl/strings/str_cat.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>
#include "tests/server/scheduler/waiting_evaluation.h"

namespace myograde::server {
namespace {

using Kind = Decision::Kind;

TEST(SchedulerTest, FillsSlotsInTheOrderOfPlay) {
  Scheduler scheduler({.slots = 2});
  scheduler.Add(WaitingEvaluation(1, "a", 3), absl::ZeroDuration());
  const auto first = scheduler.Next(absl::ZeroDuration());
  const auto second = scheduler.Next(absl::ZeroDuration());
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->lease, 1000);
  EXPECT_EQ(second->lease, 1001);
  EXPECT_NE(first->slot, second->slot);
  EXPECT_FALSE(scheduler.Next(absl::ZeroDuration()));
  EXPECT_EQ(scheduler.Finished(1000, 1, absl::ZeroDuration()).kind, Kind::kEvaluationRuns);
  EXPECT_FALSE(scheduler.Next(absl::ZeroDuration())) << "its process may still be there";
  scheduler.Free(first->slot);
  const auto third = scheduler.Next(absl::ZeroDuration());
  ASSERT_TRUE(third);
  EXPECT_EQ(third->slot, first->slot);
}

TEST(SchedulerTest, TeamsTakeTurnsWhateverTheirNumberOfSubmissions) {
  Scheduler scheduler({.slots = 1});
  for (int64_t id = 1; id <= 20; ++id) scheduler.Add(WaitingEvaluation(id, "many", 2), absl::ZeroDuration());
  ASSERT_EQ(scheduler.Next(absl::ZeroDuration())->evaluation, 1);
  scheduler.Add(WaitingEvaluation(21, "one", 1), absl::ZeroDuration());
  for (const int64_t next : {1, 21}) {
    scheduler.Finished(next == 1 ? 1000 : 1001, 1, absl::ZeroDuration());
    scheduler.Free(0);
    EXPECT_EQ(scheduler.Next(absl::ZeroDuration())->evaluation, next) << "what began ends first";
  }
}

TEST(SchedulerTest, TellsWhatWaitsByClassAndForHowLong) {
  Scheduler scheduler({.slots = 1});
  EXPECT_FALSE(scheduler.DepthAt(absl::Seconds(1)).oldest.has_value());
  scheduler.Add(WaitingEvaluation(1, "a", 2), absl::Seconds(1));
  scheduler.Add(WaitingEvaluation(2, "b", 3, Priority::kPractice), absl::Seconds(4));
  const auto of = [](const QueueDepth& depth, Priority priority) {
    const QueueDepth::OfClass& own = depth.classes[static_cast<size_t>(priority)];
    return std::pair(own.evaluations, own.blocks);
  };
  QueueDepth depth = scheduler.DepthAt(absl::Seconds(6));
  EXPECT_EQ(of(depth, Priority::kRanked), std::pair(int64_t{1}, int64_t{2}));
  EXPECT_EQ(of(depth, Priority::kPractice), std::pair(int64_t{1}, int64_t{3}));
  EXPECT_EQ(depth.oldest, absl::Seconds(5));
  // A lease of the older one starts, and so the other one has waited for longer.
  ASSERT_TRUE(scheduler.Next(absl::Seconds(7)));
  EXPECT_EQ(scheduler.taken_slots(), 1);
  depth = scheduler.DepthAt(absl::Seconds(10));
  EXPECT_EQ(of(depth, Priority::kRanked), std::pair(int64_t{1}, int64_t{1}));
  EXPECT_EQ(depth.oldest, absl::Seconds(6));
}

TEST(SchedulerTest, ATeamsRerunsWaitForItsOriginals) {
  Scheduler scheduler({.slots = 1});
  scheduler.Add(WaitingEvaluation(1, "a", 1, Priority::kRerun), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(2, "a", 1), absl::ZeroDuration());
  EXPECT_EQ(scheduler.Next(absl::ZeroDuration())->evaluation, 2);
}

TEST(SchedulerTest, PlaysAgainThreeTimesWithGrowingDelaysAndThenGivesUp) {
  Scheduler scheduler({.slots = 1, .max_retries = 3, .retry_delay = absl::Seconds(2)});
  scheduler.Add(WaitingEvaluation(1, "a", 2), absl::ZeroDuration());
  absl::Duration now = absl::ZeroDuration();
  for (int64_t attempt = 1; attempt <= 3; ++attempt) {
    // The other lease has its turn while this one waits; it is not started here, as there is one
    // slot and the earlier lease is due.
    const auto start = scheduler.Next(now);
    ASSERT_TRUE(start);
    ASSERT_EQ(start->lease, 1000);
    EXPECT_EQ(start->attempt, attempt);
    EXPECT_EQ(scheduler.Faulted(1000, attempt, now).kind, Kind::kRetry);
    scheduler.Free(start->slot);
    now += absl::Seconds(2) * (1 << (attempt - 1));
  }
  ASSERT_EQ(scheduler.Next(now)->attempt, 4);
  const Decision decision = scheduler.Faulted(1000, 4, now);
  EXPECT_EQ(decision.kind, Kind::kGiveUp);
  EXPECT_EQ(decision.pending, std::vector<int64_t>{1001});
  EXPECT_EQ(scheduler.pending(), 0);
  EXPECT_FALSE(scheduler.Next(now + absl::Hours(1)));
}

TEST(SchedulerTest, DoesNotPlayAgainWhatCanNeverBePlayed) {
  Scheduler scheduler({.slots = 1, .max_retries = 3});
  scheduler.Add(WaitingEvaluation(1, "a", 2), absl::ZeroDuration());
  ASSERT_TRUE(scheduler.Next(absl::ZeroDuration()));
  const Decision decision = scheduler.Faulted(1000, 1, absl::ZeroDuration(), /*permanent=*/true);
  EXPECT_EQ(decision.kind, Kind::kGiveUp);
  EXPECT_EQ(decision.pending, std::vector<int64_t>{1001});
}

TEST(SchedulerTest, ALateEndOfAnExpiredAttemptCountsNothing) {
  Scheduler scheduler({.slots = 1, .heartbeat = absl::Seconds(30)});
  scheduler.Add(WaitingEvaluation(1, "a", 1), absl::ZeroDuration());
  scheduler.Next(absl::ZeroDuration());
  scheduler.Heartbeat(1000, 1, absl::Seconds(20));
  EXPECT_TRUE(scheduler.OverdueAt(absl::Seconds(49)).empty());
  ASSERT_EQ(scheduler.OverdueAt(absl::Seconds(50)).size(), 1u);
  scheduler.Faulted(1000, 1, absl::Seconds(50));
  scheduler.Free(0);
  EXPECT_EQ(scheduler.Finished(1000, 1, absl::ZeroDuration()).kind, Kind::kStale);
  ASSERT_TRUE(scheduler.Next(absl::Seconds(60)));
  EXPECT_EQ(scheduler.Finished(1000, 1, absl::ZeroDuration()).kind, Kind::kStale);
  EXPECT_EQ(scheduler.Faulted(1000, 1, absl::Seconds(60)).kind, Kind::kStale);
  EXPECT_EQ(scheduler.Returned(1000, 1, absl::Seconds(60)).kind, Kind::kStale);
  EXPECT_EQ(scheduler.Finished(1000, 2, absl::ZeroDuration()).kind, Kind::kEvaluationEnds);
}

TEST(SchedulerTest, ALeaseThatKeepsBeatingStillEndsAtItsCap) {
  Scheduler scheduler({.slots = 1});
  scheduler.Add(WaitingEvaluation(1, "a", 1), absl::ZeroDuration());
  scheduler.Next(absl::ZeroDuration());
  scheduler.Heartbeat(1000, 1, absl::Seconds(99));
  EXPECT_TRUE(scheduler.OverdueAt(absl::Seconds(99)).empty());
  EXPECT_EQ(scheduler.OverdueAt(absl::Seconds(100)).size(), 1u);
  EXPECT_EQ(scheduler.NextDeadline(absl::Seconds(99)), absl::Seconds(100));
}

TEST(SchedulerTest, TellsThePlaceInTheLine) {
  Scheduler scheduler({.slots = 1});
  scheduler.Add(WaitingEvaluation(1, "a", 3), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(2, "a", 1), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(3, "b", 1), absl::ZeroDuration());
  scheduler.Next(absl::ZeroDuration());
  // Team b has had no turn, then the rest of 1, then 2.
  EXPECT_EQ(scheduler.PlaceOf(3)->position, 1);
  EXPECT_EQ(scheduler.PlaceOf(2)->position, 3);
  EXPECT_EQ(scheduler.PlaceOf(2)->blocks_ahead, 3);
  EXPECT_FALSE(scheduler.PlaceOf(9));
  const std::set<std::string> team = {"a"};
  EXPECT_EQ(scheduler.QueueOf(&team), (std::vector<int64_t>{1, 2}));
  EXPECT_NE(scheduler.WhyWaiting(2, absl::ZeroDuration()).find("1 of 1"), std::string::npos);
}

TEST(SchedulerTest, OfficialGoesBeforePracticeBeforeRerun) {
  Scheduler scheduler({.slots = 1});
  scheduler.Add(WaitingEvaluation(1, "a", 1, Priority::kRerun), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(2, "b", 1, Priority::kPractice), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(3, "c", 1), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(4, "c", 1), absl::ZeroDuration());
  EXPECT_EQ(scheduler.PlaceOf(4)->position, 2);
  EXPECT_EQ(scheduler.PlaceOf(1)->position, 4);
  for (const int64_t expected : {3, 4, 2, 1}) {
    const auto start = scheduler.Next(absl::ZeroDuration());
    ASSERT_TRUE(start);
    EXPECT_EQ(start->evaluation, expected);
    scheduler.Finished(start->lease, 1, absl::ZeroDuration());
    scheduler.Free(start->slot);
  }
}

TEST(SchedulerTest, ATeamHasNoMoreRunningThanItMay) {
  Scheduler scheduler({.slots = 3, .team_running = 2});
  scheduler.Add(WaitingEvaluation(1, "a", 3), absl::ZeroDuration());
  scheduler.Next(absl::ZeroDuration());
  const auto second = scheduler.Next(absl::ZeroDuration());
  EXPECT_FALSE(scheduler.Next(absl::ZeroDuration()));
  EXPECT_NE(scheduler.WhyWaiting(1, absl::ZeroDuration()).find("as one team may have"),
            std::string::npos);
  scheduler.Add(WaitingEvaluation(2, "b", 1), absl::ZeroDuration());
  EXPECT_EQ(scheduler.Next(absl::ZeroDuration())->evaluation, 2);
  scheduler.Finished(second->lease, 1, absl::ZeroDuration());
  scheduler.Free(second->slot);
  EXPECT_EQ(scheduler.Next(absl::ZeroDuration())->lease, 1002);
}

TEST(SchedulerTest, WhatWaitsForTooLongGoesAheadOfAll) {
  Scheduler scheduler({.slots = 1, .queue_wait = absl::Seconds(60)});
  scheduler.Add(WaitingEvaluation(1, "a", 1, Priority::kRerun), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(2, "b", 1), absl::Seconds(10));
  EXPECT_TRUE(scheduler.Escalate(absl::Seconds(59)).empty());
  EXPECT_EQ(scheduler.NextDeadline(absl::Seconds(59)), absl::Seconds(60));
  EXPECT_EQ(scheduler.PlaceOf(1)->position, 2);
  EXPECT_EQ(scheduler.Escalate(absl::Seconds(60)), std::vector<int64_t>{1});
  EXPECT_EQ(scheduler.PlaceOf(1)->position, 1);
  EXPECT_EQ(scheduler.DeadlineOf(1), absl::Seconds(120)) << "every wait has a next deadline";
  EXPECT_EQ(scheduler.Next(absl::Seconds(60))->evaluation, 1);
}

TEST(SchedulerTest, ThePlaceIsTheOrderInWhichEvaluationsStart) {
  Scheduler scheduler({.slots = 1});
  for (int64_t id = 1; id <= 12; ++id) {
    const std::string team(1, static_cast<char>('a' + id * id % 5));
    scheduler.Add(WaitingEvaluation(id, team, 1, id % 4 == 0 ? Priority::kPractice : Priority::kRanked),
                  absl::ZeroDuration());
  }
  for (int left = 12; left > 0; --left) {
    std::set<int64_t> positions;
    std::map<int64_t, int64_t> by_place;
    int64_t first = 0;
    for (int64_t id = 1; id <= 12; ++id) {
      const auto place = scheduler.PlaceOf(id);
      if (!place) continue;
      EXPECT_TRUE(positions.insert(place->position).second) << "two at one place";
      EXPECT_EQ(place->blocks_ahead, place->position - 1) << "one lease each";
      if (place->position == 1) first = id;
      by_place[place->position] = id;
    }
    EXPECT_EQ(*positions.rbegin(), left);
    std::vector<int64_t> order;
    for (const auto& [position, id] : by_place) order.push_back(id);
    EXPECT_EQ(scheduler.QueueOf(nullptr), order);
    const auto start = scheduler.Next(absl::ZeroDuration());
    EXPECT_EQ(start->evaluation, first);
    scheduler.Finished(start->lease, 1, absl::ZeroDuration());
    scheduler.Free(start->slot);
  }
}

// How many of the first `count` starts each team gets, if no lease ends.
std::map<std::string, int> FirstStarts(Scheduler& scheduler,
                                       const std::map<int64_t, std::string>& of, int count) {
  std::map<std::string, int> starts;
  for (int i = 0; i < count; ++i) {
    const auto start = scheduler.Next(absl::Seconds(1));
    if (start.has_value()) ++starts[of.at(start->evaluation)];
  }
  return starts;
}

TEST(SchedulerTest, SeveralTeamsOfOnePartyShareOneTurn) {
  Scheduler scheduler({.slots = 8});
  std::map<int64_t, std::string> who;
  for (int64_t id = 1; id <= 4; ++id) {
    EvaluationSpec spec = WaitingEvaluation(id, absl::StrCat("puppet ", id), 10);
    spec.submitter = "uid 1000";
    scheduler.Add(spec, absl::ZeroDuration());
    who[id] = "puppets";
  }
  EvaluationSpec other = WaitingEvaluation(5, "honest", 10);
  other.submitter = "uid 1001";
  scheduler.Add(other, absl::ZeroDuration());
  who[5] = "honest";
  EXPECT_EQ(scheduler.PlaceOf(5)->position, 5);
  EXPECT_EQ(FirstStarts(scheduler, who, 8),
            (std::map<std::string, int>{{"honest", 4}, {"puppets", 4}}));
}

TEST(SchedulerTest, SeveralMembersOfOneTeamShareOneTurn) {
  Scheduler scheduler({.slots = 8});
  std::map<int64_t, std::string> who;
  for (int64_t id = 1; id <= 4; ++id) {
    EvaluationSpec spec = WaitingEvaluation(id, "crowd", 10);
    spec.submitter = absl::StrCat("uid ", id);
    scheduler.Add(spec, absl::ZeroDuration());
    who[id] = "crowd";
  }
  scheduler.Add(WaitingEvaluation(5, "honest", 10), absl::ZeroDuration());
  who[5] = "honest";
  EXPECT_EQ(FirstStarts(scheduler, who, 8),
            (std::map<std::string, int>{{"crowd", 4}, {"honest", 4}}));
}

TEST(SchedulerTest, TeamsThatBecomeOneShareOneTurn) {
  Scheduler scheduler({.slots = 1});
  scheduler.Add(WaitingEvaluation(1, "a", 2), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(2, "b", 2), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(3, "c", 3), absl::ZeroDuration());
  ASSERT_EQ(scheduler.Next(absl::ZeroDuration())->evaluation, 1);
  scheduler.MoveTeam("a", "b");
  scheduler.MoveTeam("nobody", "c");
  scheduler.MoveTeam("c", "c");
  EXPECT_EQ(scheduler.Teams(), (std::vector<std::string>{"b", "c"}));
  const std::set<std::string> moved = {"a"};
  const std::set<std::string> joined = {"b"};
  EXPECT_TRUE(scheduler.QueueOf(&moved).empty());
  EXPECT_EQ(scheduler.QueueOf(&joined), (std::vector<int64_t>{1, 2}));
  // The turn that has begun goes on, and counts for both.
  std::vector<int64_t> order;
  int64_t running = 1000;
  for (int i = 0; i < 6; ++i) {
    scheduler.Finished(running, 1, absl::ZeroDuration());
    scheduler.Free(0);
    const auto start = scheduler.Next(absl::ZeroDuration());
    ASSERT_TRUE(start);
    order.push_back(start->evaluation);
    running = start->lease;
  }
  EXPECT_EQ(order, (std::vector<int64_t>{1, 3, 3, 3, 2, 2}));
  EXPECT_EQ(scheduler.Finished(running, 1, absl::ZeroDuration()).kind, Kind::kEvaluationEnds);
}

// A merge counts what runs: with one running already, the other team goes first.
TEST(SchedulerTest, ATeamThatBecomesAnotherBringsWhatItRuns) {
  Scheduler scheduler({.slots = 2});
  scheduler.Add(WaitingEvaluation(1, "a", 2), absl::ZeroDuration());
  ASSERT_EQ(scheduler.Next(absl::ZeroDuration())->evaluation, 1);
  scheduler.MoveTeam("a", "new");
  scheduler.Add(WaitingEvaluation(2, "new", 2), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(3, "c", 2), absl::ZeroDuration());
  EXPECT_EQ(scheduler.Next(absl::ZeroDuration())->evaluation, 3);
}

TEST(SchedulerTest, APlaceCostsLittleHoweverManyWait) {
  Scheduler scheduler({.slots = 2});
  for (int64_t id = 1; id <= 10'000; ++id) {
    scheduler.Add(WaitingEvaluation(id, absl::StrCat("team ", id % 200), 10), absl::ZeroDuration());
  }
  // If each place required looking at everything that waits, computing all would take minutes.
  const std::clock_t begin = std::clock();  // of the processor: the host may be busy
  std::set<int64_t> places;
  for (int64_t id = 1; id <= 10'000; ++id) {
    places.insert(scheduler.PlaceOf(id)->position);
    EXPECT_NE(scheduler.WhyWaiting(id, absl::ZeroDuration()), "");
    (void)scheduler.NextDeadline(absl::ZeroDuration());
  }
  EXPECT_EQ(places.size(), 10'000u);
  EXPECT_LT(std::clock() - begin, 30 * CLOCKS_PER_SEC);
}

// The expected state, tracked independently of the scheduler.
struct Model {
  std::map<int64_t, std::pair<int64_t, int>> running;  // lease to attempt and slot
  std::map<int64_t, int> faults;
  std::map<int64_t, std::set<int64_t>> open;           // evaluation to blocks
  std::set<int64_t> done;
  std::set<int64_t> ended;
  std::vector<int> to_free;                            // slots whose lease is over
};

void CheckDecision(Model& model, int64_t lease, const Decision& decision) {
  const int64_t evaluation = lease / 1000;
  switch (decision.kind) {
    case Kind::kEvaluationEnds:
    case Kind::kGiveUp:
      RC_ASSERT(model.ended.insert(evaluation).second);  // only once
      for (const int64_t other : decision.running) {
        model.to_free.push_back(model.running.at(other).second);
        model.running.erase(other);
      }
      model.open.erase(evaluation);
      break;
    case Kind::kStale:
      RC_FAIL("a current attempt was called stale");
    default:
      break;
  }
}

RC_GTEST_PROP(SchedulerTest, EveryEvaluationEndsAndNothingCountsTwice, ()) {
  const int slots = *rc::gen::inRange(1, 5);
  Scheduler scheduler({.slots = slots, .max_retries = 3, .retry_delay = absl::Seconds(1),
                       .heartbeat = absl::Seconds(10),
                       .queue_wait = absl::Seconds(20)});
  Model model;
  absl::Duration now = absl::ZeroDuration();
  int64_t next_id = 1;
  const auto start_all = [&] {
    for (const int slot : model.to_free) scheduler.Free(slot);
    model.to_free.clear();
    while (const auto start = scheduler.Next(now)) {
      RC_ASSERT(!model.running.contains(start->lease));
      RC_ASSERT(!model.done.contains(start->lease));
      RC_ASSERT(start->slot < slots);
      for (const auto& [lease, at] : model.running) RC_ASSERT(at.second != start->slot);
      model.running[start->lease] = {start->attempt, start->slot};
    }
    while (const auto lease = scheduler.Preempt(now)) {
      RC_ASSERT(model.running.at(lease->lease).first == lease->attempt);
      model.to_free.push_back(model.running.at(lease->lease).second);
      model.running.erase(lease->lease);
    }
    RC_ASSERT(static_cast<int>(model.running.size()) == scheduler.running());
  };
  const auto end = [&](int64_t lease, bool fault) {
    const int64_t attempt = model.running.at(lease).first;
    model.to_free.push_back(model.running.at(lease).second);
    model.running.erase(lease);
    if (fault) {
      RC_ASSERT(++model.faults[lease] <= 4);
      CheckDecision(model, lease, scheduler.Faulted(lease, attempt, now));
    } else {
      RC_ASSERT(model.done.insert(lease).second);
      model.open.at(lease / 1000).erase(lease);
      CheckDecision(model, lease, scheduler.Finished(lease, attempt, now));
    }
    RC_ASSERT(scheduler.Finished(lease, attempt, now).kind == Kind::kStale);
  };
  const auto some_running = [&] {
    auto it = model.running.begin();
    std::advance(it, *rc::gen::inRange<size_t>(0, model.running.size()));
    return it->first;
  };
  const int steps = *rc::gen::inRange(1, 80);
  for (int i = 0; i < steps; ++i) {
    for (const int64_t late : scheduler.Escalate(now)) RC_ASSERT(model.open.contains(late));
    start_all();
    now += absl::Milliseconds(*rc::gen::inRange(0, 3000));
    const int what = *rc::gen::inRange(0, 6);
    if (what == 0 || model.running.empty()) {
      const int leases = *rc::gen::inRange(1, 5);
      const std::string team(1, static_cast<char>('a' + *rc::gen::inRange(0, 4)));
      const EvaluationSpec spec = WaitingEvaluation(next_id++, team, leases, *rc::gen::element(
          Priority::kRanked, Priority::kPractice, Priority::kRerun, Priority::kRejudge));
      for (const BlockSpec& lease : spec.blocks) model.open[spec.id].insert(lease.id);
      scheduler.Add(spec, now);
    } else if (what <= 2) {
      end(some_running(), /*fault=*/false);
    } else if (what == 3) {
      end(some_running(), /*fault=*/true);
    } else if (what == 4) {
      const int64_t id = *rc::gen::inRange<int64_t>(1, next_id);
      const Decision decision = scheduler.Cancel(id);
      RC_ASSERT((decision.kind == Kind::kStale) == model.ended.contains(id));
      if (decision.kind != Kind::kStale) {
        RC_ASSERT(decision.running.size() + decision.pending.size() == model.open.at(id).size());
        CheckDecision(model, id * 1000, decision);
      }
    } else {
      now += absl::Seconds(11);  // all runners were silent
      for (const Overdue& late : scheduler.OverdueAt(now)) {
        if (model.running.contains(late.lease)) end(late.lease, /*fault=*/true);
      }
    }
  }
  // From here on nothing fails: everything must finish.
  for (int rounds = 0; rounds < 1000 && !model.open.empty(); ++rounds) {
    now += absl::Seconds(10);
    start_all();
    while (!model.running.empty()) end(model.running.begin()->first, /*fault=*/false);
  }
  RC_ASSERT(model.open.empty());
  RC_ASSERT(static_cast<int64_t>(model.ended.size()) == next_id - 1);
  RC_ASSERT(scheduler.pending() == 0);
}

}  // namespace
}  // namespace myograde::server
