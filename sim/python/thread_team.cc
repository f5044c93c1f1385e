#include "sim/python/thread_team.h"

#include <memory>

namespace myograde::sim {

ThreadTeam::ThreadTeam(int threads) {
  for (int i = 1; i < threads; ++i) workers_.emplace_back([this] { Work(); });
}

ThreadTeam::~ThreadTeam() {
  if (!alive()) {
    for (std::thread& worker : workers_) worker.detach();
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  begin_.notify_all();
  for (std::thread& worker : workers_) worker.join();
}

void ThreadTeam::ForEach(int count, const std::function<void(int)>& body) {
  next_ = 0;
  {
    const std::lock_guard lock(mutex_);
    count_ = count;
    body_ = &body;
    busy_ = static_cast<int>(workers_.size());
    ++round_;
  }
  begin_.notify_all();
  TakeIndices(count, body);
  std::unique_lock lock(mutex_);
  end_.wait(lock, [this] { return busy_ == 0; });
}

void ThreadTeam::Work() {
  uint64_t seen = 0;
  while (true) {
    int count;
    const std::function<void(int)>* body;
    {
      std::unique_lock lock(mutex_);
      begin_.wait(lock, [&] { return stop_ || round_ != seen; });
      if (stop_) return;
      seen = round_;
      count = count_;
      body = body_;
    }
    TakeIndices(count, *body);
    {
      const std::lock_guard lock(mutex_);
      if (--busy_ > 0) continue;
    }
    end_.notify_one();
  }
}

void ThreadTeam::TakeIndices(int count, const std::function<void(int)>& body) {
  for (int i = next_++; i < count; i = next_++) body(i);
}

}  // namespace myograde::sim
