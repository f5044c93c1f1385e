// What the runner of a lease looks at while nobody speaks: the policy's use of processors, and
// what of it could not be killed yet.
#include <poll.h>

#include <algorithm>
#include <random>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "server/runner/lease_runner.h"

namespace myograde::server {
namespace {

// Looks at the policy, in multiples of cpu_refresh_s: no two are further apart.
constexpr double kMostRefreshes = 5;
// Whether it is idle is asked this seldom, as all of its threads are looked at; and however late
// the look comes, it tells of no more than this.
constexpr absl::Duration kIdleLooks = absl::Milliseconds(100);
constexpr absl::Duration kMostIdle = absl::Milliseconds(500);
// For what can't be killed; the simulator waits a little longer (kSandboxDeadline there).
constexpr absl::Duration kLeftoverPatience = absl::Minutes(4);
constexpr int kLeftoverLook = 100;  // ms

}  // namespace

// At moments that nobody in the sandbox can foresee, cpu_refresh_s apart in the mean: whoever
// knew them could let its processes be gone, or busy, just then.
void LeaseRunner::LookAtPolicy() {
  policy_->Look();
  RefreshCpu(/*by_chance=*/true);
  const absl::Duration now = SystemClock().Monotonic();
  if (now - last_idle_look_ >= kIdleLooks) CountIdle();
  std::exponential_distribution<double> gap(1 / context_.config.policy.cpu_refresh_s);
  next_look_ = SystemClock().Monotonic() +
               std::min(absl::Seconds(gap(chance_)), kMostRefreshes * absl::Seconds(
                                                         context_.config.policy.cpu_refresh_s));
}

// Idle is who was asked for an answer and wants no processor: neither a busy host nor a pause
// of all of it makes a policy idle. Nor, while it starts up, does a slow disk.
void LeaseRunner::CountIdle() {
  const absl::Duration now = SystemClock().Monotonic();
  const absl::Duration since = std::min(now - last_idle_look_, kMostIdle);
  last_idle_look_ = now;
  const auto count = [&](const std::atomic<uint64_t>& asked, auto&& busy,
                         std::atomic<uint64_t>& idle_ns) {
    const uint64_t wait = asked.load();
    // The simulator may have its answer already and wait for a processor itself.
    if (wait % 2 == 0 || SimRuns() || busy(policy_->Processes()) || SimRuns()) return;
    if (asked.load() != wait) return;
    idle_ns.fetch_add(static_cast<uint64_t>(absl::ToInt64Nanoseconds(since)));
  };
  count(cpu_page_->waits, AnyRuns, cpu_page_->idle_ns);
  count(cpu_page_->starts, AnyRunsOrReads, cpu_page_->start_idle_ns);
}

bool LeaseRunner::SimRuns() {
  if (!sim_tree_.has_value()) return AnyRuns(sim_group_->Members());
  sim_tree_->CpuNs(/*by_chance=*/false);
  return AnyRuns(sim_tree_->members());
}

// The slot is the caller's again when this process is dead.
void LeaseRunner::WaitForLeftovers() {
  while (!leftovers_.Gone()) {
    pollfd entries[] = {{stop_, POLLIN, 0}, {signals_, POLLIN, 0}};
    if (poll(entries, std::size(entries), kLeftoverLook) > 0) return;
  }
}

// The simulator waits for a policy that is not to run beside what is left of the one before.
absl::Status LeaseRunner::GiveOnceAlone() {
  if (leftovers_.Gone()) {
    asked_alone_.reset();
    return GivePolicy();
  }
  if (SystemClock().Monotonic() - *asked_alone_ < kLeftoverPatience) return absl::OkStatus();
  asked_alone_.reset();
  FaultEvidence evidence = last_ruling_;
  absl::StrAppend(&evidence.detail, "; what it left behind could not be killed in ",
                  absl::FormatDuration(kLeftoverPatience), ", so nothing more was started");
  nlohmann::json answer = FaultEvidenceToJson(evidence);
  answer["type"] = "no_policy";
  return SendSimMessage(channel_.get(), answer);
}

}  // namespace myograde::server
