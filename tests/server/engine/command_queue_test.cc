// Commands from other threads for the daemon's loop: all are answered, none waits indefinitely.
#include "server/engine/engine.h"

#include <poll.h>

#include <atomic>
#include <memory>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace myograde::server {
namespace {

bool Readable(int fd, int wait_ms) {
  pollfd entry = {fd, POLLIN, 0};
  return poll(&entry, 1, wait_ms) == 1;
}

// Waits for a command that answers as soon as it runs.
absl::Status Call(CommandQueue& queue, std::function<absl::Status()> command,
                  absl::Duration timeout) {
  return queue.Call(
      [command = std::move(command)](const CommandQueue::Answer& answer) { answer(command()); },
      timeout);
}

// A loop like the daemon's: runs commands until it is told to stop.
class Loop {
 public:
  explicit Loop(CommandQueue& queue)
      : queue_(queue), thread_([this] {
          while (!stop_) {
            if (Readable(queue_.wake_fd(), 1000)) queue_.RunAll();
          }
        }) {}
  ~Loop() {
    stop_ = true;
    queue_.Wake();
    thread_.join();
  }

 private:
  CommandQueue& queue_;
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

TEST(CommandQueue, RunsEveryCommandOnceOnTheLoopsThread) {
  CommandQueue queue(1000);
  const Loop loop(queue);
  std::atomic<int> ran = 0;
  std::vector<std::thread> callers;
  for (int i = 0; i < 8; ++i) {
    callers.emplace_back([&, i] {
      for (int k = 0; k < 50; ++k) {
        const auto caller = std::this_thread::get_id();
        const absl::Status status = Call(
            queue,
            [&ran, caller, i] {
              EXPECT_NE(std::this_thread::get_id(), caller);
              ++ran;
              return i == 3 ? absl::NotFoundError("three") : absl::OkStatus();
            },
            absl::Seconds(30));
        EXPECT_EQ(absl::IsNotFound(status), i == 3) << status;
        EXPECT_EQ(status.ok(), i != 3) << status;
      }
    });
  }
  for (std::thread& caller : callers) caller.join();
  EXPECT_EQ(ran, 400);
}

TEST(CommandQueue, KeepsTheOrderAndTellsHowManyItRan) {
  CommandQueue queue(10);
  EXPECT_EQ(queue.RunAll(), 0);
  std::vector<int> order;
  for (int i = 0; i < 3; ++i) {
    const absl::Status status = Call(
        queue,
        [&order, i] {
          order.push_back(i);
          return absl::OkStatus();
        },
        absl::ZeroDuration());
    EXPECT_TRUE(absl::IsDeadlineExceeded(status)) << status;
  }
  EXPECT_TRUE(Readable(queue.wake_fd(), 0));
  EXPECT_EQ(queue.RunAll(), 3);
  EXPECT_EQ(order, (std::vector<int>{0, 1, 2}));
  EXPECT_FALSE(Readable(queue.wake_fd(), 0));
}

TEST(CommandQueue, ALateCommandStillRunsAndOwnsWhatItTouches) {
  CommandQueue queue(10);
  const auto touched = std::make_shared<int>(0);
  EXPECT_TRUE(absl::IsDeadlineExceeded(Call(
      queue,
      [touched] {
        ++*touched;
        return absl::OkStatus();
      },
      absl::Milliseconds(5))));
  EXPECT_EQ(queue.RunAll(), 1);
  EXPECT_EQ(*touched, 1);
}

TEST(CommandQueue, RefusesMoreThanItsCapacity) {
  CommandQueue queue(2);
  const auto nothing = [] { return absl::OkStatus(); };
  EXPECT_TRUE(absl::IsDeadlineExceeded(Call(queue, nothing, absl::ZeroDuration())));
  EXPECT_TRUE(absl::IsDeadlineExceeded(Call(queue, nothing, absl::ZeroDuration())));
  EXPECT_TRUE(absl::IsResourceExhausted(Call(queue, nothing, absl::Seconds(30))));
  EXPECT_EQ(queue.RunAll(), 2);
  EXPECT_TRUE(absl::IsDeadlineExceeded(Call(queue, nothing, absl::ZeroDuration())));
}

TEST(CommandQueue, ClosingAnswersAllThatWaitsAndAllThatComes) {
  CommandQueue queue(10);
  absl::Status waiting;
  std::thread caller([&] {
    waiting = Call(
        queue, [] { return absl::OkStatus(); }, absl::Seconds(30));
  });
  EXPECT_TRUE(Readable(queue.wake_fd(), 10'000));
  queue.Close();
  caller.join();
  EXPECT_TRUE(absl::IsCancelled(waiting)) << waiting;
  EXPECT_TRUE(absl::IsCancelled(Call(
      queue, [] { return absl::OkStatus(); }, absl::Seconds(30))));
  EXPECT_EQ(queue.RunAll(), 0);
}

}  // namespace
}  // namespace myograde::server
