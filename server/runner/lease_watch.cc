// What the runner samples while no messages arrive: the policy's use of processors, and leftovers
// that could not be killed yet.
#include <poll.h>

#include <algorithm>
#include <random>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "server/runner/lease_runner.h"

namespace myograde::server {
namespace {

// The longest gap between samples of the policy, in multiples of cpu_refresh_s.
constexpr double kMostRefreshes = 5;
// Idleness is sampled this rarely, as that reads all of the policy's threads; however late a sample
// is, it accounts for at most kMostIdle.
constexpr absl::Duration kIdleSampleInterval = absl::Milliseconds(100);
constexpr absl::Duration kMostIdle = absl::Milliseconds(500);
// For what can't be killed; the simulator waits a little longer (its kSandboxDeadline).
constexpr absl::Duration kLeftoverPatience = absl::Minutes(4);
constexpr int kLeftoverPollMs = 100;

}  // namespace

// Samples at moments that nobody in the sandbox can foresee, cpu_refresh_s apart on average:
// otherwise a policy could have its processes gone, or busy, just then.
void LeaseRunner::SamplePolicy() {
  policy_->Sample();
  RefreshCpu(/*by_chance=*/true);
  const absl::Duration now = SystemClock().Monotonic();
  if (now - last_idle_sample_ >= kIdleSampleInterval) CountIdle();
  std::exponential_distribution<double> gap(1 / context_.config.policy.cpu_refresh_s);
  next_sample_ = SystemClock().Monotonic() +
               std::min(absl::Seconds(gap(chance_)), kMostRefreshes * absl::Seconds(
                                                         context_.config.policy.cpu_refresh_s));
}

// A policy is idle if it owes an answer and wants no processor: neither a busy host nor a pause of
// everything makes it idle. Nor does a slow disk during start-up.
void LeaseRunner::CountIdle() {
  const absl::Duration now = SystemClock().Monotonic();
  const absl::Duration since = std::min(now - last_idle_sample_, kMostIdle);
  last_idle_sample_ = now;
  const auto count = [&](const std::atomic<uint64_t>& asked, const char* busy,
                         std::atomic<uint64_t>& idle_ns) {
    const uint64_t wait = asked.load();
    // The simulator may already have its answer and be waiting for a processor itself.
    if (wait % 2 == 0 || SimRuns() || AnyThreadIs(busy, policy_->Processes()) || SimRuns()) return;
    if (asked.load() != wait) return;
    idle_ns.fetch_add(static_cast<uint64_t>(absl::ToInt64Nanoseconds(since)));
  };
  count(cpu_page_->waits, "R", cpu_page_->idle_ns);
  count(cpu_page_->starts, "RD", cpu_page_->start_idle_ns);
}

bool LeaseRunner::SimRuns() {
  if (!sim_tree_.has_value()) return AnyThreadIs("R", sim_group_->Members());
  sim_tree_->CpuNs(/*by_chance=*/false);
  return AnyThreadIs("R", sim_tree_->members());
}

void LeaseRunner::EndRun(std::unique_ptr<PolicyRun> run) {
  if (run->End()) return;
  leftovers_.push_back([left = std::shared_ptr(std::move(run))] { return left->Gone(); });
}

bool LeaseRunner::Alone() {
  std::erase_if(leftovers_, [](const std::function<bool()>& gone) { return gone(); });
  return leftovers_.empty();
}

// The caller reuses the slot once this process is dead.
void LeaseRunner::WaitForLeftovers() {
  while (!Alone()) {
    pollfd entries[] = {{stop_, POLLIN, 0}, {signals_, POLLIN, 0}};
    if (poll(entries, std::size(entries), kLeftoverPollMs) > 0) return;
  }
}

// Answers the simulator's request for a policy once nothing is left of the previous one.
absl::Status LeaseRunner::SendPolicyWhenAlone() {
  if (Alone()) {
    policy_requested_at_.reset();
    return SendPolicy();
  }
  if (SystemClock().Monotonic() - *policy_requested_at_ < kLeftoverPatience) {
    return absl::OkStatus();
  }
  policy_requested_at_.reset();
  FaultEvidence evidence = last_ruling_;
  absl::StrAppend(&evidence.detail, "; what it left behind could not be killed in ",
                  absl::FormatDuration(kLeftoverPatience), ", so nothing more was started");
  nlohmann::json answer = FaultEvidenceToJson(evidence);
  answer["type"] = "no_policy";
  return SendSimMessage(channel_.get(), answer);
}

}  // namespace myograde::server
