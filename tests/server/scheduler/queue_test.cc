// What people see of the queue: what runs, then what waits, in the order of its places.
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "server/scheduler/scheduler.h"
#include "tests/server/scheduler/waiting_evaluation.h"

namespace myograde::server {
namespace {

TEST(QueueOf, ShowsWhatRunsAndThenWhatWaitsOfSomeTeams) {
  Scheduler scheduler({.slots = 1});
  const std::set<std::string> own = {"b", "nobody"};
  EXPECT_TRUE(scheduler.QueueOf(nullptr).empty());
  scheduler.Add(WaitingEvaluation(1, "a", 1), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(2, "a", 1), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(3, "b", 1), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(4, "b", 2, Priority::kPractice), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(5, "b", 1, Priority::kRerun), absl::ZeroDuration());
  scheduler.Add(WaitingEvaluation(6, "b", 1, Priority::kRejudge), absl::ZeroDuration());
  ASSERT_EQ(scheduler.Next(absl::ZeroDuration())->evaluation, 1);
  EXPECT_EQ(scheduler.QueueOf(nullptr), (std::vector<int64_t>{1, 3, 2, 4}));
  EXPECT_EQ(scheduler.QueueOf(&own), (std::vector<int64_t>{3, 4}));
  // All of them have waited for too long, the oldest of each team first; it runs and waits nowhere.
  scheduler.Escalate(absl::Hours(2));
  EXPECT_EQ(scheduler.QueueOf(nullptr), (std::vector<int64_t>{1, 3, 2, 4}));
  scheduler.Finished(1000, 1, absl::ZeroDuration());
  scheduler.Free(0);
  ASSERT_EQ(scheduler.Next(absl::Hours(2))->evaluation, 3);
  scheduler.Finished(3000, 1, absl::ZeroDuration());
  scheduler.Free(0);
  ASSERT_EQ(scheduler.Next(absl::Hours(2))->evaluation, 2);
  scheduler.Finished(2000, 1, absl::ZeroDuration());
  scheduler.Free(0);
  ASSERT_EQ(scheduler.Next(absl::Hours(2))->evaluation, 4);
  EXPECT_EQ(scheduler.QueueOf(&own), (std::vector<int64_t>{4})) << "once, though a block waits";
}

}  // namespace
}  // namespace myograde::server
