// Plays one lease: the simulator in one sandbox, the policy in another, and the
// runner between them and the caller. Single-threaded.
#pragma once

#include <memory>
#include <optional>
#include <random>
#include <string>

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "protocol/lease/lease.h"
#include "protocol/lease/sim_channel.h"
#include "server/runner/leftovers.h"
#include "server/runner/policy_run.h"

namespace myograde::server {

class LeaseRunner {
 public:
  // `records`: where the records go, a line each. `stop`: a descriptor that
  // gets readable (or its other end closed) when the caller wants the lease to
  // end; -1 if there is none. `signals`: a signalfd with the same meaning.
  LeaseRunner(const LeaseContext& context, int records, int stop, int signals);
  ~LeaseRunner();

  // Plays the lease and prints its records, the last one included. Then waits until all that
  // it started is dead, or the caller wants it to end. True: all episodes were recorded.
  bool Run();

 private:
  absl::Status Play();
  absl::Status StartSim();
  // Waits for something to happen and sees to it. Sets done_.
  absl::Status RunOnce();
  absl::Status HandleSimMessage();
  absl::Status HandleRecord(const nlohmann::json& json);
  absl::Status PreparePolicy();
  absl::Status GivePolicy();
  absl::Status GiveOnceAlone();
  absl::Status GiveLog();
  absl::Status RuleOn(const nlohmann::json& json);
  absl::Status CheckDeadlines() const;
  absl::Status SimEnded();
  void EndSim();
  void EndPolicy();
  void SeeOffPolicy();
  void WaitForLeftovers();
  void LookAtPolicy();
  void CountIdle();
  bool SimRuns();
  void RefreshCpu(bool by_chance = false);
  absl::Status GiveCpu();
  absl::Status Beat();
  absl::Status Print(const LeaseRecord& record);

  const LeaseContext& context_;
  const int records_;
  const int stop_;
  const int signals_;

  // In this order: the sandbox goes before its group.
  std::unique_ptr<ControlGroup> sim_group_;
  std::unique_ptr<Sandbox> sim_;
  std::optional<ProcessTree> sim_tree_;  // where no control group names its processes
  Fd channel_;
  Fd sim_stderr_;
  OutputTail sim_errors_;
  CpuPage* cpu_page_ = nullptr;
  Fd cpu_page_fd_;

  // The next run and the simulator's end of its channel. The first is built
  // while the simulator loads: both wait for the kernel, once instead of twice.
  std::unique_ptr<PolicyRun> prepared_;
  Fd prepared_channel_;
  std::unique_ptr<PolicyRun> policy_;
  Leftovers leftovers_;
  std::optional<absl::Duration> asked_alone_;  // a policy was asked for while something was left
  FaultEvidence last_ruling_;
  int runs_ = 0;
  OutputTail stdout_;
  OutputTail stderr_;
  int64_t finished_cpu_ns_ = 0;  // of runs that ended
  int64_t peak_memory_ = 0;

  size_t next_episode_ = 0;  // place in the order of the next to be recorded
  bool done_ = false;
  ProgressRecord progress_;
  // Moments of the monotonic clock.
  absl::Duration start_;
  absl::Duration last_heard_;
  absl::Duration last_printed_;
  absl::Duration next_look_;
  absl::Duration last_idle_look_;
  std::mt19937_64 chance_{std::random_device{}()};  // of moments, never of results
};

}  // namespace myograde::server
