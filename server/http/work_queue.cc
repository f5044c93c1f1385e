#include "server/http/work_queue.h"

#include <algorithm>

namespace myograde::server {

bool WorkQueue::Line::empty() const {
  return busy == 0 && std::ranges::all_of(jobs, [](const auto& queue) { return queue.empty(); });
}

void WorkQueue::Push(Job job) {
  {
    const MutexLock lock(mutex_);
    Line& line = lines_[job.peer.key];
    line.organiser = job.peer.organiser;
    line.jobs[static_cast<size_t>(job.work)].push_back(std::move(job));
    ++waiting_;
  }
  ready_.NotifyOne();
}

bool WorkQueue::MayWork(const Line& line) const {
  return line.organiser || (others_busy_ < limits_.workers - limits_.kept &&
                            line.busy < limits_.of_a_peer);
}

std::optional<Job> WorkQueue::Take() {
  auto it = lines_.upper_bound(last_);
  for (size_t i = 0; i < lines_.size(); ++i, ++it) {
    if (it == lines_.end()) it = lines_.begin();
    Line& line = it->second;
    if (!MayWork(line)) continue;
    for (size_t kind = 0; kind < kWorkKinds; ++kind) {
      if (line.jobs[kind].empty() || busy_[kind] >= limits_.of_a_kind[kind]) continue;
      Job job = std::move(line.jobs[kind].front());
      line.jobs[kind].pop_front();
      last_ = it->first;
      --waiting_;
      ++line.busy;
      ++busy_[kind];
      if (!line.organiser) ++others_busy_;
      return job;
    }
  }
  return std::nullopt;
}

std::optional<Job> WorkQueue::Pop() {
  const MutexLock lock(mutex_);
  for (;;) {
    if (closed_) return std::nullopt;
    if (std::optional<Job> job = Take()) {
      // Each wakes the next, since what one Done allows may be more than one job.
      if (waiting_ > 0) ready_.NotifyOne();
      return job;
    }
    ready_.Wait(mutex_);
  }
}

void WorkQueue::Done(const Job& job) {
  {
    const MutexLock lock(mutex_);
    const auto it = lines_.find(job.peer.key);
    --it->second.busy;
    --busy_[static_cast<size_t>(job.work)];
    if (!it->second.organiser) --others_busy_;
    if (it->second.empty()) lines_.erase(it);
    if (waiting_ == 0) return;
  }
  ready_.NotifyOne();
}

void WorkQueue::Close() {
  {
    const MutexLock lock(mutex_);
    closed_ = true;
  }
  ready_.NotifyAll();
}

void WorkQueue::Clear() {
  std::map<std::string, Line> lines;
  const MutexLock lock(mutex_);
  lines.swap(lines_);
}

}  // namespace myograde::server
