// What other threads see of the engine.
#include <algorithm>

#include <absl/strings/str_cat.h>

#include "server/engine/engine_core.h"

namespace myograde::server {
namespace {

// So many leases in a row are no accident of single nodes any more.
constexpr int kManyLosses = 10;

}  // namespace

QueueOutlook EngineCore::OutlookOf(int64_t evaluation) const {
  const MutexLock lock(mutex_);
  const absl::Duration now = clock_.Monotonic();
  QueueOutlook outlook;
  const std::optional<absl::Duration> deadline = scheduler_.DeadlineOf(evaluation);
  if (!deadline.has_value()) return outlook;
  if (*deadline != absl::InfiniteDuration()) {
    outlook.deadline = std::max(*deadline - now, absl::ZeroDuration());
  }
  outlook.place = scheduler_.PlaceOf(evaluation);
  outlook.waiting = scheduler_.WhyWaiting(evaluation, now);
  outlook.owner = owner_;
  if (!outlook.waiting.empty()) {
    const auto add = [&](const char* what, const std::string& why) {
      if (!why.empty()) absl::StrAppend(&outlook.waiting, "; nothing starts", what, ": ", why);
    };
    add("", host_.PauseReason(now));
    for (const auto& [slot, why] : troubles_.closed_slots) {
      absl::StrAppend(&outlook.waiting, "; slot ", slot, " is closed until ", why, " is gone");
    }
    add("", troubles_.executor_trouble);
    add("", troubles_.disk_trouble);
    add(" while the store can't be written", troubles_.store_trouble);
  }
  if (outlook.place.has_value() && mean_lease_ > absl::ZeroDuration() && host_.may_start()) {
    const auto ahead = static_cast<double>(outlook.place->leases_ahead + scheduler_.running());
    const auto own = static_cast<double>(scheduler_.WaitingLeasesOf(evaluation));
    outlook.end = mean_lease_ * std::max((ahead + own) / options_.config.scheduler.slots, 1.0);
  }
  return outlook;
}

std::vector<int64_t> EngineCore::QueueOf(const std::set<std::string>* teams) const {
  const MutexLock lock(mutex_);
  return scheduler_.QueueOf(teams);
}

std::map<int64_t, LiveLease> EngineCore::Running(const std::set<int64_t>* among) const {
  const MutexLock lock(mutex_);
  const absl::Duration now = clock_.Monotonic();
  std::map<int64_t, LiveLease> leases;
  const auto add = [&](int64_t id, const Live& live) {
    LiveLease& shown = leases.emplace_hint(leases.end(), id, live.lease)->second;
    shown.running = now - live.since;
    shown.silent = now - live.heard;
  };
  if (among == nullptr) {
    for (const auto& [id, live] : live_) add(id, live);
    return leases;
  }
  for (const int64_t id : *among) {
    if (const auto live = live_.find(id); live != live_.end()) add(id, live->second);
  }
  return leases;
}

LiveHealth EngineCore::Health() const {
  const MutexLock lock(mutex_);
  const absl::Duration now = clock_.Monotonic();
  LiveHealth health;
  static_cast<EngineTroubles&>(health) = troubles_;
  health.running = scheduler_.running();
  health.pending = scheduler_.pending();
  if (lost_in_a_row_ >= kManyLosses) {
    health.losses = absl::StrCat("the last ", lost_in_a_row_, " leases were lost, the latest because: ",
                                 last_loss_);
  }
  health.host = host_.state();
  health.host_trouble = host_.PauseReason(now);
  health.journal = journal_size_;
  health.busy_slots = scheduler_.taken_slots() - static_cast<int>(troubles_.closed_slots.size());
  health.queue = scheduler_.DepthAt(now);
  for (const auto& [id, live] : live_) {
    const absl::Duration age = now - live.since;
    health.oldest_run = std::max(health.oldest_run.value_or(age), age);
  }
  if (health.host == HostHealth::State::kPaused) health.paused_for = now - host_.paused_since();
  if (const auto next = host_.NextTest()) {
    health.next_test = std::max(*next - now, absl::ZeroDuration());
  }
  return health;
}

}  // namespace myograde::server
