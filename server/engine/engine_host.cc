// Host health: when the grader's own faults repeat, it tests itself.
#include <sys/wait.h>

#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "server/base/ip_address.h"
#include "server/engine/engine_core.h"
#include "server/metrics/disk_space.h"

namespace myograde::server {
namespace {

constexpr int kExitStatus = 7;                           // of the self-test's policy
constexpr int kWaitStatus = W_EXITCODE(kExitStatus, 0);  // as reported in records

}  // namespace

void EngineCore::PollSelfTest() {
  if (test_.has_value()) {
    if (const auto verdict = TestVerdict()) EndSelfTest(*verdict);
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
  // The test gets the next slot that becomes free, as no lease starts.
  if (!slot.has_value()) return;
  spdlog::info("self-test on slot {}", *slot);
  const LeaseOrder order = MakeLeaseOrder(
      "selftest-1", suspect_track_->config, {{0, 0, 0}},
      {.artefact_dir = options_.data_dir + "/selftest",  // an empty folder
       .command = {"/bin/sh", "-c", absl::StrCat("exit ", kExitStatus)},
       .environment = {},
       .runtimes = {}},
      {.slot = *slot,
       .work_dir = options_.data_dir + "/work/selftest",
       .cache_dir = options_.cache_dir,
       .log_dir = ""});
  SelfTest& test = test_.emplace();
  test.slot = *slot;
  test.work_dir = order.work_dir;
  test.deadline = clock_.Monotonic() + options_.config.self_test_deadline;
  test.report = LeaseReport(order.episodes, {}, absl::ZeroDuration());
  absl::StatusOr<std::unique_ptr<Runner>> runner = executor_.Start(order, {});
  if (!runner.ok()) {
    return test.report.Fail(
        absl::StrCat("the runner did not start: ", runner.status().message()));
  }
  test.runner = *std::move(runner);
}

std::optional<std::string> EngineCore::TestVerdict() {
  SelfTest& test = *test_;
  if (test.runner == nullptr) return test.report.fault();
  const absl::StatusOr<std::vector<LeaseRecord>> records = test.runner->Read();
  if (!records.ok()) return std::string(records.status().message());
  const absl::Duration now = clock_.Monotonic();
  const LeaseReport::News news = test.report.Take(*records, now);
  if (!news.episodes.empty()) test.facts = news.episodes.back();
  const bool finished = test.runner->finished();
  if (finished) test.report.Conclude(test.runner->wait_status(), test.runner->stderr_tail());
  if (test.report.faulty()) return test.report.fault();
  if (!finished && now < test.deadline) return std::nullopt;
  if (!finished) return "it did not end in time";
  const FaultEvidence& fault = test.facts->fault;
  if (fault.outcome == Outcome::kCrash && fault.value == kWaitStatus) return "";
  return absl::StrCat("its policy exits at once with status ", kExitStatus,
                      ", but the record has: ",
                      fault.detail.empty() ? "no fault" : fault.detail);
}

void EngineCore::EndSelfTest(const std::string& fault) {
  SelfTest test = *std::exchange(test_, std::nullopt);
  if (stopping_) {
    spdlog::info("self-test ended with the daemon");
  } else if (fault.empty()) {
    spdlog::info("self-test passed");
  } else {
    spdlog::error("self-test failed: {}", fault);
  }
  if (test.runner != nullptr && !test.runner->dead()) {
    Stop(std::move(test), /*ask=*/true);
  } else {
    if (test.runner != nullptr) executor_.CleanUp(test.work_dir);
    FreeSlot(test.slot);
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
  const nlohmann::json about = {{"host", HostName()}};
  if (paused) TellLater(kSelfTestFailedEvent, about);
  if (paused != was_paused) TellLater(paused ? kHostPausedEvent : kHostResumedEvent, about);
}

// Below the reserve no lease begins. Those that run go on, and need little of it.
bool EngineCore::LookAtDisk() {
  next_disk_look_ = clock_.Monotonic() + absl::Seconds(1);
  std::string trouble = LackOfRoom(options_.data_dir, options_.config.artefacts.disk_reserve);
  const MutexLock lock(mutex_);
  // The number of bytes changes all the time.
  const bool was_short = !troubles_.disk_trouble.empty();
  if (trouble.empty() && was_short) spdlog::info("the disk has enough free space again");
  if (!trouble.empty() && !was_short) spdlog::error("no lease can start: {}", trouble);
  troubles_.disk_trouble = std::move(trouble);
  return troubles_.disk_trouble.empty();
}

}  // namespace myograde::server
