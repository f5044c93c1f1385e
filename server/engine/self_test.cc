#include "server/engine/self_test.h"

#include <sys/wait.h>

#include <absl/strings/str_cat.h>

namespace myograde::server {
namespace {

constexpr int kExitStatus = 7;
constexpr int kWaitStatus = W_EXITCODE(kExitStatus, 0);  // as records tell it

}  // namespace

LeaseOrder SelfTestOrder(const TrackConfig& track, const std::string& artefact_dir,
                         const std::string& work_dir, const std::string& cache_dir) {
  LeaseOrder order;
  order.lease = "selftest-1";
  order.artefact_dir = artefact_dir;
  order.command = {"/bin/sh", "-c", absl::StrCat("exit ", kExitStatus)};
  order.track = track;
  order.episodes = {{0, 0, 0}};
  order.work_dir = work_dir;
  order.cache_dir = cache_dir;
  return order;
}

std::unique_ptr<SelfTest> SelfTest::Begin(Processes& processes, const LeaseOrder& order,
                                          absl::Duration deadline) {
  std::unique_ptr<SelfTest> test(new SelfTest(order, deadline));
  absl::StatusOr<std::unique_ptr<Runner>> runner = processes.Start(order);
  if (runner.ok()) {
    test->runner_ = *std::move(runner);
  } else {
    test->fault_ = absl::StrCat("the runner did not start: ", runner.status().message());
  }
  return test;
}

std::optional<std::string> SelfTest::Look(absl::Duration now) {
  if (runner_ == nullptr) return fault_;
  absl::StatusOr<std::vector<LeaseRecord>> records = runner_->Read();
  if (!records.ok()) return std::string(records.status().message());
  for (const LeaseRecord& record : *records) {
    if (const auto* facts = std::get_if<EpisodeFacts>(&record)) facts_ = *facts;
    if (const auto* end = std::get_if<LeaseEndRecord>(&record)) end_ = *end;
  }
  if (runner_->finished()) return Verdict();
  if (now >= deadline_) return "it was not over in its time";
  return std::nullopt;
}

std::string SelfTest::Verdict() const {
  if (!end_.has_value()) {
    return absl::StrCat("the runner ended (wait status ", runner_->wait_status(),
                        ") without its last record");
  }
  if (!end_->ok) return end_->detail;
  if (!facts_.has_value()) return "no episode was recorded";
  if (facts_->fault.outcome != Outcome::kCrash || facts_->fault.value != kWaitStatus) {
    return absl::StrCat("its policy ends at once with status ", kExitStatus,
                        ", and the record says otherwise: ",
                        facts_->fault.detail.empty() ? std::string("no fault")
                                                     : facts_->fault.detail);
  }
  return "";
}

}  // namespace myograde::server
