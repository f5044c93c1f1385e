// How the HTTP threads ask the daemon's loop to do something: bounded, and with
// a deadline for the answer.
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

  // Readable while there is something to do.
  int wake_fd() const { return wake_.get(); }

  // Runs `command` on the loop's thread and waits for its status.
  // ResourceExhaustedError: too many wait already. CancelledError: the daemon
  // stops. DeadlineExceededError: no answer in time; the command may still run,
  // so it must own everything that it touches.
  absl::Status Call(std::function<absl::Status()> command, absl::Duration timeout);

  // Says how a command went; to be called once, at any later time, on the loop's thread.
  using Answer = std::function<void(absl::Status)>;
  // Like Call, for a command that is not through when it returns: the caller
  // waits until its Answer is called.
  absl::Status CallLater(std::function<void(Answer)> command, absl::Duration timeout);

  // Loop only: runs what waits. Returns how many it ran.
  int RunAll();

  // Makes the loop's poll return; safe to call from a signal handler.
  void Wake();

  // Answers all that waits, and all that comes, with CancelledError.
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
