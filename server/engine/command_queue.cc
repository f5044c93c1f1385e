#include "server/engine/command_queue.h"

#include <sys/eventfd.h>

namespace myograde::server {
namespace {

absl::Status Stopping() {
  return absl::CancelledError("the daemon is stopping; try again when it is back");
}

}  // namespace

CommandQueue::CommandQueue(size_t capacity)
    : capacity_(capacity), wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}

void CommandQueue::Wake() {
  const uint64_t one = 1;
  [[maybe_unused]] const ssize_t n = write(wake_.get(), &one, sizeof(one));
}

absl::Status CommandQueue::Call(std::function<void(Answer)> command, absl::Duration timeout) {
  std::future<absl::Status> answer;
  {
    const MutexLock lock(mutex_);
    if (closed_) return Stopping();
    if (entries_.size() >= capacity_) {
      return absl::ResourceExhaustedError("too many commands wait already; try again in a second");
    }
    entries_.push_back({std::move(command), std::make_shared<std::promise<absl::Status>>()});
    answer = entries_.back().answer->get_future();
  }
  Wake();
  if (answer.wait_for(absl::ToChronoNanoseconds(timeout)) != std::future_status::ready) {
    return absl::DeadlineExceededError(
        "the daemon did not get to it in time; ask for the status before you try again");
  }
  return answer.get();
}

int CommandQueue::RunAll() {
  uint64_t count = 0;
  [[maybe_unused]] const ssize_t n = read(wake_.get(), &count, sizeof(count));
  std::deque<Entry> entries;
  {
    const MutexLock lock(mutex_);
    entries.swap(entries_);
  }
  for (Entry& entry : entries) {
    entry.command([answer = entry.answer](absl::Status status) { answer->set_value(status); });
  }
  return static_cast<int>(entries.size());
}

void CommandQueue::Close() {
  const MutexLock lock(mutex_);
  closed_ = true;
  for (Entry& entry : entries_) entry.answer->set_value(Stopping());
  entries_.clear();
}

}  // namespace myograde::server
