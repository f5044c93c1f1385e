#include "sim/python/thread_team.h"

#include <chrono>
#include <memory>

namespace myograde::sim {
namespace {

// How long a thread looks for its next loop, or for the others' end, before it sleeps. A learner
// asks for the next step within some ten microseconds, and to wake a thread of a virtual machine
// takes longer than that.
constexpr std::chrono::microseconds kLookingFor{200};

// Waits until `value` is no longer `old`, and lets other threads run meanwhile.
template <typename T>
void AwaitChange(const std::atomic<T>& value, T old) {
  const auto until = std::chrono::steady_clock::now() + kLookingFor;
  while (value.load(std::memory_order_acquire) == old) {
    if (std::chrono::steady_clock::now() >= until) {
      value.wait(old, std::memory_order_acquire);
      return;
    }
    std::this_thread::yield();
  }
}

}  // namespace

ThreadTeam::ThreadTeam(int threads) {
  for (int i = 1; i < threads; ++i) workers_.emplace_back([this] { Work(); });
}

ThreadTeam::~ThreadTeam() {
  if (!alive()) {
    for (std::thread& worker : workers_) worker.detach();
    return;
  }
  stop_ = true;
  ++round_;
  round_.notify_all();
  for (std::thread& worker : workers_) worker.join();
}

void ThreadTeam::ForEach(int count, const std::function<void(int)>& body) {
  next_ = 0;
  count_ = count;
  body_ = &body;
  busy_ = static_cast<int>(workers_.size());
  ++round_;
  round_.notify_all();
  TakeIndices(count, body);
  while (const int busy = busy_.load(std::memory_order_acquire)) AwaitChange(busy_, busy);
}

void ThreadTeam::Work() {
  uint64_t seen = 0;
  while (true) {
    AwaitChange(round_, seen);
    ++seen;
    if (stop_) return;
    TakeIndices(count_, *body_);
    --busy_;
    busy_.notify_one();
  }
}

void ThreadTeam::TakeIndices(int count, const std::function<void(int)>& body) {
  for (int i = next_++; i < count; i = next_++) body(i);
}

}  // namespace myograde::sim
