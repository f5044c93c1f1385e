#include "server/challenge/calendar_watch.h"

namespace myograde::server {

std::optional<absl::Duration> CalendarWatch::Jump(absl::Time calendar, absl::Duration monotonic) {
  const absl::Time started = calendar - monotonic;
  const MutexLock lock(mutex_);
  const absl::Duration jump = started - started_.value_or(started);
  started_ = started;
  if (absl::AbsDuration(jump) <= kTolerance) return std::nullopt;
  return jump;
}

}  // namespace myograde::server
