// Hands work from the HTTP threads to the daemon's loop. Bounded; every caller waits for its answer
// with a deadline.
#pragma once

#include <deque>
#include <functional>
#include <future>
#include <memory>

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "protocol/base/mutex.h"

namespace myograde::server {

class CommandQueue {
 public:
  // REQUIRES: capacity > 0.
  explicit CommandQueue(size_t capacity);

  // Readable while commands are queued.
  int wake_fd() const { return wake_.get(); }

  // Reports a command's status. Call it exactly once, at any later time, on the loop's thread.
  using Answer = std::function<void(absl::Status)>;
  // Runs `command` on the loop's thread and waits until its Answer is called.
  // ResourceExhaustedError: the queue is full. CancelledError: the daemon is stopping.
  // DeadlineExceededError: no answer in time; the command may still run, so it must own everything
  // that it touches.
  absl::Status Call(std::function<void(Answer)> command, absl::Duration timeout);

  // Loop thread only: runs the queued commands and returns how many there were.
  int RunAll();

  // Makes the loop's poll return; safe to call from a signal handler.
  void Wake();

  // Answers every queued and every later command with CancelledError.
  void Close();

 private:
  struct Entry {
    std::function<void(Answer)> command;
    std::shared_ptr<std::promise<absl::Status>> answer;
  };

  const size_t capacity_;
  Fd wake_;  // an eventfd
  Mutex mutex_;
  std::deque<Entry> entries_ ABSL_GUARDED_BY(mutex_);
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace myograde::server
