// Which job is next: round robin, within the limits of its kind, and with a reserve for organisers.
#include "server/http/work_queue.h"

#include <gtest/gtest.h>

#include <future>
#include <string>
#include <vector>

namespace myograde::server {
namespace {

Job JobOf(const std::string& key, WorkKind work = WorkKind::kServe) {
  return {nullptr, work, {key, key == "root", 1}};
}

constexpr WorkQueue::Limits kLimits = {
    .workers = 8, .kept = 2, .of_a_peer = 3, .of_a_kind = {8, 2, 2, 1}};

// The jobs that may run at once, in order, until the queue would block.
std::vector<Job> TakeAll(WorkQueue& queue, size_t expected) {
  std::vector<Job> jobs;
  for (size_t i = 0; i < expected; ++i) jobs.push_back(*queue.Pop());
  return jobs;
}

// True if nobody may run now.
bool Waits(WorkQueue& queue) {
  auto next = std::async(std::launch::async, [&] { return queue.Pop(); });
  const bool waits = next.wait_for(std::chrono::milliseconds(50)) == std::future_status::timeout;
  queue.Close();
  return waits && !next.get().has_value();
}

TEST(WorkQueue, PeersTakeTurns) {
  WorkQueue queue({.workers = 8, .kept = 0, .of_a_peer = 8, .of_a_kind = {8, 8, 8, 8}});
  for (int i = 0; i < 3; ++i) queue.Push(JobOf("a"));
  queue.Push(JobOf("b"));
  queue.Push(JobOf("c"));
  std::string order;
  for (const Job& job : TakeAll(queue, 5)) order += job.peer.key;
  EXPECT_EQ(order, "abcaa");
}

TEST(WorkQueue, APeerHasAtMostItsShareAndTheOthersTheirs) {
  WorkQueue queue(kLimits);
  for (int i = 0; i < 20; ++i) queue.Push(JobOf("a"));
  for (int i = 0; i < 20; ++i) queue.Push(JobOf("b"));
  for (int i = 0; i < 20; ++i) queue.Push(JobOf("c"));
  std::map<std::string, int> taken;
  for (const Job& job : TakeAll(queue, 6)) ++taken[job.peer.key];
  for (const auto& [key, count] : taken) EXPECT_LE(count, 3) << key;
  // Two workers are left, reserved for organisers.
  queue.Push(JobOf("root"));
  queue.Push(JobOf("root"));
  for (const Job& job : TakeAll(queue, 2)) EXPECT_EQ(job.peer.key, "root");
  EXPECT_TRUE(Waits(queue));
}

TEST(WorkQueue, AFullKindHoldsUpNoOther) {
  WorkQueue queue(kLimits);
  for (int i = 0; i < 5; ++i) queue.Push(JobOf("root", WorkKind::kLargeUpload));
  queue.Push(JobOf("root"));
  const std::vector<Job> jobs = TakeAll(queue, 2);
  EXPECT_EQ(jobs[0].work, WorkKind::kServe);
  EXPECT_EQ(jobs[1].work, WorkKind::kLargeUpload);
  queue.Done(jobs[1]);
  EXPECT_EQ(queue.Pop()->work, WorkKind::kLargeUpload);
  EXPECT_TRUE(Waits(queue));
}

TEST(WorkQueue, WhatIsDoneMakesRoom) {
  WorkQueue queue(kLimits);
  for (int i = 0; i < 5; ++i) queue.Push(JobOf("a"));
  std::vector<Job> jobs = TakeAll(queue, 3);
  auto next = std::async(std::launch::async, [&] { return queue.Pop(); });
  EXPECT_EQ(next.wait_for(std::chrono::milliseconds(50)), std::future_status::timeout);
  queue.Done(jobs[0]);
  EXPECT_TRUE(next.get().has_value());
  queue.Close();
  EXPECT_FALSE(queue.Pop().has_value());
}

}  // namespace
}  // namespace myograde::server
