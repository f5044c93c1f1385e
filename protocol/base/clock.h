// Time as seen by code that waits or measures. Passed in where it is needed, so
// that tests can turn the hands themselves.
#pragma once

#include <algorithm>

#include <absl/time/time.h>

namespace myograde {

class Clock {
 public:
  virtual ~Clock() = default;

  // Time since an arbitrary start. Never jumps and never runs backwards: the
  // one to take for deadlines and durations.
  virtual absl::Duration Monotonic() const = 0;

  // The host's calendar time, which can jump: only for stamps that people read.
  virtual absl::Time Now() const = 0;
};

// The host's clocks. Lives for ever; safe to use from any thread.
const Clock& SystemClock();

// A moment by which something must have happened, on a clock's monotonic hand.
class Deadline {
 public:
  explicit Deadline(absl::Duration from_now, const Clock& clock = SystemClock())
      : clock_(&clock), at_(clock.Monotonic() + from_now) {}

  bool over() const { return clock_->Monotonic() >= at_; }
  // What is left of it, never negative.
  absl::Duration left() const {
    return std::max(at_ - clock_->Monotonic(), absl::ZeroDuration());
  }

 private:
  const Clock* clock_;
  absl::Duration at_;
};

// A clock that stands still until it is moved. Not thread-safe.
class ManualClock : public Clock {
 public:
  explicit ManualClock(absl::Time start = absl::UnixEpoch()) : start_(start) {}

  absl::Duration Monotonic() const override { return elapsed_; }
  absl::Time Now() const override { return start_ + elapsed_ + jump_; }

  // Lets time pass. REQUIRES: step >= 0.
  void Advance(absl::Duration step) { elapsed_ += step; }
  // Sets the calendar forwards or back, as an administrator would.
  void Jump(absl::Duration step) { jump_ += step; }

 private:
  absl::Time start_;
  absl::Duration elapsed_;
  absl::Duration jump_;
};

}  // namespace myograde
