#include "server/engine/self_test.h"

#include <sys/wait.h>

#include <absl/strings/str_cat.h>

#include "server/runner/runner_process.h"

namespace myograde::server {
namespace {

constexpr int kExitStatus = 7;
constexpr int kWaitStatus = W_EXITCODE(kExitStatus, 0);  // as reported in records

}  // namespace

LeaseOrder SelfTestOrder(const TrackConfig& track, const std::string& artefact_dir,
                         const std::string& work_dir, const std::string& cache_dir) {
  return MakeLeaseOrder("selftest-1", track, {{0, 0, 0}},
                        {.artefact_dir = artefact_dir,
                         .command = {"/bin/sh", "-c", absl::StrCat("exit ", kExitStatus)},
                         .environment = {},
                         .runtimes = {},
                         .extra_observations = false},
                        {.work_dir = work_dir, .cache_dir = cache_dir, .log_dir = ""});
}

SelfTest::SelfTest(Executor& executor, const LeaseOrder& order, absl::Duration deadline)
    : order_(order), deadline_(deadline), report_(order.episodes, {}, absl::ZeroDuration()) {
  absl::StatusOr<std::unique_ptr<Runner>> runner = executor.Start(order, {});
  if (runner.ok()) {
    runner_ = *std::move(runner);
  } else {
    report_.Fail(absl::StrCat("the runner did not start: ", runner.status().message()));
  }
}

std::optional<std::string> SelfTest::Poll(absl::Duration now) {
  if (runner_ == nullptr) return report_.fault();
  absl::StatusOr<std::vector<LeaseRecord>> records = runner_->Read();
  if (!records.ok()) return std::string(records.status().message());
  const LeaseReport::News news = report_.Take(*records, now);
  if (!news.episodes.empty()) facts_ = news.episodes.back();
  if (runner_->finished()) return Result();
  report_.Tick(now);
  if (report_.faulty()) return report_.fault();
  if (now >= deadline_) return "it was not over in its time";
  return std::nullopt;
}

std::string SelfTest::Result() {
  report_.Conclude(runner_->wait_status(), runner_->stderr_tail());
  if (report_.faulty()) return report_.fault();
  if (facts_->fault.outcome != Outcome::kCrash || facts_->fault.value != kWaitStatus) {
    return absl::StrCat("its policy ends at once with status ", kExitStatus,
                        ", and the record says otherwise: ",
                        facts_->fault.detail.empty() ? std::string("no fault")
                                                     : facts_->fault.detail);
  }
  return "";
}

}  // namespace myograde::server
