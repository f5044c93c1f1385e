// Host health: when the grader's own faults repeat, it tests itself.
#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/config_reader.h"
#include "server/base/ip_address.h"
#include "server/engine/engine_core.h"
#include "server/metrics/disk_space.h"

namespace myograde::server {

void EngineCore::PollSelfTest() {
  if (test_ != nullptr) {
    const std::optional<std::string> verdict = test_->Poll(clock_.Monotonic());
    if (verdict.has_value()) EndSelfTest(*verdict);
    return;
  }
  bool due = false;
  {
    const MutexLock lock(mutex_);
    due = host_.TestDue(clock_.Monotonic());
  }
  if (due && !stopping_) BeginSelfTest();
}

void EngineCore::BeginSelfTest() {
  std::optional<int> slot;
  {
    const MutexLock lock(mutex_);
    slot = scheduler_.TakeSlot();
    if (slot.has_value()) host_.TestBegins();
  }
  if (!slot.has_value()) return;  // the test gets the next slot that becomes free, as no lease
                                  // starts
  LeaseOrder order =
      SelfTestOrder(suspect_track_->config, absl::StrCat(options_.data_dir, "/selftest"),
                    absl::StrCat(options_.data_dir, "/work/selftest"), options_.cache_dir);
  order.slot = *slot;
  spdlog::info("self-test on slot {}", *slot);
  test_ = std::make_unique<SelfTest>(executor_, order,
                                     clock_.Monotonic() + options_.config.self_test_deadline);
}

void EngineCore::EndSelfTest(const std::string& fault) {
  const LeaseOrder order = test_->order();
  std::unique_ptr<Runner> runner = test_->TakeRunner();
  test_ = nullptr;
  if (stopping_) {
    spdlog::info("self-test ended with the daemon");
  } else if (fault.empty()) {
    spdlog::info("self-test passed");
  } else {
    spdlog::error("self-test failed: {}", fault);
  }
  if (runner != nullptr && !runner->dead()) {
    runner->AskToEnd();
    stopping_runners_.push_back({0, 0, static_cast<int>(order.slot), order.work_dir,
                                 std::move(runner),
                                 clock_.Monotonic() + Runner::kCleanUpGrace});
  } else {
    if (runner != nullptr) executor_.CleanUp(order.work_dir);
    FreeSlot(static_cast<int>(order.slot));
  }
  bool was_paused = false;
  bool paused = false;
  {
    const MutexLock lock(mutex_);
    was_paused = host_.state() == HostHealth::State::kPaused;
    host_.TestEnded(clock_.Monotonic(), fault);
    paused = host_.state() == HostHealth::State::kPaused;
  }
  if (stopping_) return;
  metrics().CountSelfTest(fault.empty());
  // The fault itself names files of this host, so it is only logged.
  const std::string about = CanonicalJson({{"host", HostName()}});
  if (paused) TellLater(kSelfTestFailedEvent, about);
  if (paused != was_paused) TellLater(paused ? kHostPausedEvent : kHostResumedEvent, about);
}

// Below the reserve no lease begins. Those that run go on, and need little of it.
void EngineCore::LookAtDisk() {
  next_disk_look_ = clock_.Monotonic() + absl::Seconds(1);
  std::string trouble = LackOfRoom(options_.data_dir, options_.config.artefacts.disk_reserve);
  const MutexLock lock(mutex_);
  // The number of bytes changes all the time.
  if (trouble.empty() && !disk_trouble_.empty()) spdlog::info("the disk has its reserve again");
  if (!trouble.empty() && disk_trouble_.empty()) spdlog::error("no lease begins: {}", trouble);
  disk_trouble_ = std::move(trouble);
}

bool EngineCore::ShortOfRoom() const {
  const MutexLock lock(mutex_);
  return !disk_trouble_.empty();
}

}  // namespace myograde::server
