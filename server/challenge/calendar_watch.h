// Notices that the host's calendar was set.
#pragma once

#include <optional>

#include <absl/time/time.h>

#include "protocol/base/mutex.h"

namespace myograde::server {

// Safe from any thread.
class CalendarWatch {
 public:
  // By how much the calendar moved against the monotonic clock since the last call, if by more than
  // kTolerance; forward is positive. Adjustments smaller than that are never added up.
  std::optional<absl::Duration> Jump(absl::Time calendar, absl::Duration monotonic) {
    const absl::Time started = calendar - monotonic;
    const MutexLock lock(mutex_);
    const absl::Duration jump = started - started_.value_or(started);
    started_ = started;
    if (absl::AbsDuration(jump) <= kTolerance) return std::nullopt;
    return jump;
  }

  static constexpr absl::Duration kTolerance = absl::Minutes(1);

 private:
  Mutex mutex_;
  std::optional<absl::Time> started_ ABSL_GUARDED_BY(mutex_);  // the calendar's time at monotonic 0
};

}  // namespace myograde::server
