// Threads that share the indices of a loop between them, again and again.
#pragma once

#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <thread>
#include <vector>

namespace myograde::sim {

// Not thread-safe itself: one loop at a time.
class ThreadTeam {
 public:
  // `threads`: at least 1; the calling thread is one of them.
  explicit ThreadTeam(int threads);
  // Waits for the threads. In a process that was forked off there are none, and nothing to wait for.
  ~ThreadTeam();
  ThreadTeam(const ThreadTeam&) = delete;
  ThreadTeam& operator=(const ThreadTeam&) = delete;

  // Calls body(0) to body(count - 1), each once, on whichever thread is free, and returns when all
  // are done. `body` must not throw. REQUIRES: alive().
  void ForEach(int count, const std::function<void(int)>& body);

  // False in a process that was forked off: threads don't go along.
  bool alive() const { return getpid() == owner_; }
  int threads() const { return static_cast<int>(workers_.size()) + 1; }

 private:
  void Work();
  void TakeIndices(int count, const std::function<void(int)>& body);

  const pid_t owner_ = getpid();
  // What the next loop does; written while no worker is in one.
  bool stop_ = false;
  int count_ = 0;
  const std::function<void(int)>* body_ = nullptr;

  std::atomic<uint64_t> round_{0};  // loops begun
  std::atomic<int> busy_{0};        // workers that have not finished this loop
  std::atomic<int> next_{0};        // the first index that nobody has taken
  std::vector<std::thread> workers_;
};

}  // namespace myograde::sim
