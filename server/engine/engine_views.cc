// What other threads see of the engine.
#include <algorithm>

#include <absl/strings/str_cat.h>

#include "server/engine/engine_core.h"

namespace myograde::server {

QueueOutlook EngineCore::OutlookOf(int64_t evaluation) const {
  const std::lock_guard lock(mutex_);
  const absl::Duration now = clock_.Monotonic();
  QueueOutlook prospect;
  const std::optional<absl::Duration> deadline = scheduler_.DeadlineOf(evaluation);
  if (!deadline.has_value()) return prospect;
  prospect.deadline = std::max(*deadline - now, absl::ZeroDuration());
  prospect.place = scheduler_.PlaceOf(evaluation);
  prospect.waiting = scheduler_.WhyWaiting(evaluation, now);
  prospect.owner = owner_;
  if (!prospect.waiting.empty()) {
    if (const std::string why = host_.PauseReason(now); !why.empty()) {
      absl::StrAppend(&prospect.waiting, "; nothing starts: ", why);
    }
    for (const auto& [slot, why] : closed_slots_) {
      absl::StrAppend(&prospect.waiting, "; slot ", slot, " is closed until ", why, " is gone");
    }
    if (!store_trouble_.empty()) {
      absl::StrAppend(&prospect.waiting,
                      "; nothing starts while the store can't be written: ", store_trouble_);
    }
  }
  if (prospect.place.has_value() && mean_lease_ > absl::ZeroDuration() && host_.may_start()) {
    const auto ahead = static_cast<double>(prospect.place->leases_ahead + scheduler_.running());
    const auto own = static_cast<double>(scheduler_.WaitingLeasesOf(evaluation));
    prospect.end = mean_lease_ * std::max((ahead + own) / options_.config.scheduler.slots, 1.0);
  }
  return prospect;
}

std::map<int64_t, LiveLease> EngineCore::Running() const {
  const std::lock_guard lock(mutex_);
  const absl::Duration now = clock_.Monotonic();
  std::map<int64_t, LiveLease> leases;
  for (const auto& [id, live] : live_) {
    leases[id] = {live.evaluation, live.submission, live.slot, live.process, live.episode,
                  live.step, now - live.since, now - live.heard};
  }
  return leases;
}

LiveHealth EngineCore::Health() const {
  const std::lock_guard lock(mutex_);
  const absl::Duration now = clock_.Monotonic();
  LiveHealth health;
  health.running = scheduler_.running();
  health.pending = scheduler_.pending();
  health.ending = ending_count_;
  health.closed_slots = closed_slots_;
  health.store_trouble = store_trouble_;
  health.unreadable = unreadable_;
  health.host = host_.state();
  health.host_trouble = host_.PauseReason(now);
  if (health.host == HostHealth::State::kPaused) health.paused_for = now - host_.paused_since();
  if (const auto next = host_.NextTest()) {
    health.next_test = std::max(*next - now, absl::ZeroDuration());
  }
  return health;
}

}  // namespace myograde::server
