// Clocks for code that waits or measures. Passed in where needed, so that tests can control time.
#pragma once

#include <algorithm>
#include <stop_token>

#include <absl/time/time.h>

namespace myograde {

class Clock {
 public:
  virtual ~Clock() = default;

  // Time since an arbitrary start. Never jumps or runs backwards: use it for deadlines and
  // durations.
  virtual absl::Duration Monotonic() const = 0;

  // The host's calendar time, which can jump: use it only for timestamps that people read.
  virtual absl::Time Now() const = 0;
};

// The host's clocks. Never destroyed; safe to use from any thread.
const Clock& SystemClock();

// A deadline on a clock's monotonic time.
class Deadline {
 public:
  explicit Deadline(absl::Duration from_now, const Clock& clock = SystemClock())
      : clock_(&clock), at_(clock.Monotonic() + from_now) {}

  bool over() const { return clock_->Monotonic() >= at_; }
  // The time left, never negative.
  absl::Duration left() const {
    return std::max(at_ - clock_->Monotonic(), absl::ZeroDuration());
  }

 private:
  const Clock* clock_;
  absl::Duration at_;
};

// Waits for a stop of this thread (std::jthread) to be requested, for a finite time at most; true
// if it was.
bool WaitForStop(const std::stop_token& stop, absl::Duration at_most);

// A clock that moves only when told to. Not thread-safe.
class ManualClock : public Clock {
 public:
  explicit ManualClock(absl::Time start = absl::UnixEpoch()) : start_(start) {}

  absl::Duration Monotonic() const override { return elapsed_; }
  absl::Time Now() const override { return start_ + elapsed_ + jump_; }

  // Advances both clocks. REQUIRES: step >= 0.
  void Advance(absl::Duration step) { elapsed_ += step; }
  // Sets the calendar forwards or back, as an administrator would.
  void Jump(absl::Duration step) { jump_ += step; }

 private:
  absl::Time start_;
  absl::Duration elapsed_;
  absl::Duration jump_;
};

}  // namespace myograde
