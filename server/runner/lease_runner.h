// Plays one lease: some consecutive episodes of an evaluation, by one policy. The simulator is in one
// sandbox, the policy in another, and the runner between them and the caller. Single-threaded. In
// order of time:
//
//  1. The runner starts the simulator in its sandbox. It gets its order (seeds, track, budgets) as a
//     memory file, a channel to the runner, a page on which the runner writes the CPU time that the
//     policy has used, and a pipe for the logs. It has no network and no file that it can write.
//  2. While the simulator loads the model, the runner builds the policy's sandbox: the artefact,
//     scratch folders, a network namespace of its own with LCM's multicast, limits on memory,
//     processes, disk and sockets. The bridge and the policy start in it, stopped.
//  3. The simulator asks for a policy ("need_policy"). The runner lets it run, and hands the other
//     end of its bridge's channel to the simulator. From here on the two talk without the runner.
//  4. Each step, the simulator writes an observation to the bridge, which publishes it over LCM, and
//     waits for the action at most as long as the budget allows. The runner meanwhile reads what
//     the policy prints, samples its resource use, and prints a heartbeat for the caller.
//  5. When an episode has ended, the simulator sends its facts. The runner checks that they are of
//     the next episode of the order, keeps its log, and prints the record on one line: from then on
//     the episode counts, whatever happens later.
//  6. If the policy fails (it died, was silent, or sent what the protocol does not allow), the
//     simulator reports what it saw ("policy_fault"). The runner adds what the kernel counted,
//     decides whose fault it was, kills the sandbox, and answers ("ruling"). A participant's fault
//     ends that episode; the next one starts with a fresh policy, at most `restarts` times. A fault
//     of the grader ends the lease, which the caller retries as a whole.
//  7. After the last episode the simulator says "done". The policy has a moment to exit, then both
//     sandboxes are killed, and the runner prints the end record: output, CPU time, memory.
//  8. The runner itself ends when everything that it started is dead, so that its slot is free then.
//
// Every wait has a deadline: a silent simulator, a lease that takes too long, a caller that reads no
// records, and each step of a policy. The caller may end the lease at any time.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "protocol/lease/lease.h"
#include "protocol/lease/sim_channel.h"
#include "server/runner/policy_run.h"

namespace myograde::server {

class LeaseRunner {
 public:
  // `records`: the descriptor that records are written to, one line each. `stop`: a descriptor that
  // becomes readable (or whose other end closes) when the caller wants the lease to end; -1 if
  // there is none. `signals`: a signalfd with the same meaning.
  LeaseRunner(const LeaseContext& context, int records, int stop, int signals);
  ~LeaseRunner();

  // Plays the lease and prints its records, including the end record. Then waits until everything
  // it started is dead, or the caller asks it to stop. True: all episodes were recorded.
  bool Run();

 private:
  absl::Status Play();
  absl::Status StartSim();
  // Waits for the next event and handles it. Sets done_.
  absl::Status RunOnce();
  absl::Status HandleSimMessage();
  absl::Status HandleRecord(const nlohmann::json& json);
  absl::Status PreparePolicy();
  absl::Status SendPolicy();
  absl::Status SendPolicyWhenAlone();
  absl::Status SendLog();
  absl::Status KeepTrajectory(const nlohmann::json& json);
  absl::Status JudgeFault(const nlohmann::json& json);
  absl::Status CheckDeadlines() const;
  void AwaitSimExit();
  absl::Status SimEnded();
  void EndSim();
  void EndPolicy();
  void AwaitPolicyExit();
  // Ends a run, which becomes a leftover if any of its processes survive. Takes up to kill_s.
  void EndRun(std::unique_ptr<PolicyRun> run);
  // Nothing of what was killed is left.
  bool Alone();
  void WaitForLeftovers();
  void SamplePolicy();
  void CountIdle();
  bool SimRuns();
  void RefreshCpu(bool by_chance = false);
  absl::Status ReportCpu();
  absl::Status Heartbeat();
  // A record's line.
  absl::Status Print(std::string line);

  const LeaseContext& context_;
  const int records_;
  const int stop_;
  const int signals_;

  // Declared in this order so that the sandbox is destroyed before its group.
  std::unique_ptr<ControlGroup> sim_group_;
  std::unique_ptr<Sandbox> sim_;
  std::optional<ProcessTree> sim_tree_;  // used when no control group lists its processes
  Fd channel_;
  Fd sim_stderr_;
  OutputTail sim_errors_;
  CpuPage* cpu_page_ = nullptr;
  Fd cpu_page_fd_;

  // The next run, and the simulator's end of its channel. The first run is built while the
  // simulator loads, so that their waits for the kernel overlap.
  std::unique_ptr<PolicyRun> prepared_;
  Fd prepared_channel_;
  std::unique_ptr<PolicyRun> policy_;
  // Of what was killed but is not dead yet (a process stuck in the kernel, or so many that a busy
  // host takes long to reap them): whether it is gone now; never blocks. After SIGKILL processes
  // run none of their own code, but they hold their user, memory and disk until they are gone. So
  // no other policy starts beside them, and the slot stays taken. What the lease has recorded
  // stands.
  std::vector<std::function<bool()>> leftovers_;
  // Set while the simulator waits for a policy that can't start beside leftovers.
  std::optional<absl::Duration> policy_requested_at_;
  FaultEvidence last_ruling_;
  int runs_ = 0;
  OutputTail stdout_;
  OutputTail stderr_;
  int64_t finished_cpu_ns_ = 0;  // of finished runs
  int64_t sim_cpu_ns_ = 0;
  int64_t peak_memory_ = 0;

  size_t next_episode_ = 0;  // index into the order of the next episode to be recorded
  bool done_ = false;
  ProgressRecord progress_;
  // Monotonic times.
  absl::Duration start_;
  absl::Duration last_heard_;
  absl::Duration last_printed_;
  absl::Duration next_sample_;
  absl::Duration last_idle_sample_;
  std::mt19937_64 chance_{std::random_device{}()};  // randomises timing, never results
};

}  // namespace myograde::server
