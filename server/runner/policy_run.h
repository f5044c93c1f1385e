// One run of a policy: its sandbox from start to end, its resource use, and the ruling on its
// fault.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "protocol/lease/lease.h"
#include "server/base/child_process.h"
#include "server/runner/log_keeper.h"
#include "server/sandbox/policy_sandbox.h"
#include "server/sandbox/process_tree.h"

namespace myograde::server {

// Shared by all runs of a lease.
struct LeaseContext {
  const LeaseOrder& order;
  const SandboxConfig& config;
  const std::string bin_dir;
  const Stage& stage;
  const EtcFiles& etc;
  LogKeeper* logs = nullptr;           // null: keep no logs
  const std::vector<Fd>& replays;      // the files of LeaseOrder::replay, opened
  TrajectoryFile* trajectory = nullptr;  // of LeaseOrder::trajectory; null: none is made
};

class PolicyRun {
 public:
  // Builds the sandbox of run `number` of the lease; no participant code runs before Begin().
  // `bridge_socket` becomes the bridge's. The tails must outlive the run. An error is the grader's.
  static absl::StatusOr<std::unique_ptr<PolicyRun>> Prepare(const LeaseContext& context,
                                                            int number, Fd bridge_socket,
                                                            OutputTail& out, OutputTail& err);
  ~PolicyRun();

  void Begin() { sandbox_->Release(); }

  // Descriptors to poll for POLLIN; -1 once the stream has ended.
  int stdout_fd() const { return stdout_.get(); }
  int stderr_fd() const { return stderr_.get(); }

  // True once nothing in its sandbox is running; never blocks.
  bool Ended() { return sandbox_->Ended(); }

  // Reads what the policy printed. Bounded work per call.
  void DrainOutput();

  // Samples how full its scratch folders are and how many sockets it has. Cheap. Ends the run at
  // once if it is over a limit.
  void Sample();

  // Resets the count of lost messages: losses so far can't explain a missed deadline in the next
  // episode.
  void EpisodeOver();

  // CPU time of everything in the sandbox so far, never less than before. `by_chance`: nobody in
  // the sandbox could foresee this moment.
  int64_t CpuNs(bool by_chance = false);
  // All processes in the sandbox; where CPU time is sampled, as of the last sample.
  std::vector<pid_t> Processes() const;
  int64_t peak_memory_bytes() const { return group_->peak_memory_bytes(); }

  // Ends the run and rules on the fault that the simulator saw: what the kernel counted may be its
  // cause.
  FaultEvidence Rule(FaultEvidence seen);

  // Kills everything in it. False: something could not be killed in kill_s. How the run ended
  // stands; its owner then polls Gone().
  bool End();
  // After End(): true once nothing of it is left. Never blocks.
  bool Gone();

 private:
  PolicyRun(const LeaseContext& context, OutputTail& out, OutputTail& err)
      : context_(context), out_(out), err_(err) {}
  bool KernelCause(FaultEvidence& evidence) const;
  // Charges the bytes held by its sockets to its memory limit.
  void CountSocketBytes();
  void ExcuseLostMessages(FaultEvidence& evidence) const;

  const LeaseContext& context_;
  OutputTail& out_;
  OutputTail& err_;
  // Declared in this order so that the sandbox is destroyed before its group, and both before the
  // mount.
  std::string scratch_;
  std::unique_ptr<ControlGroup> group_;
  std::unique_ptr<Sandbox> sandbox_;
  std::optional<ProcessTree> tree_;  // used when no control group counts CPU time
  Fd stdout_;
  Fd stderr_;
  ScratchUsage disk_;
  int64_t sockets_ = 0;      // peak
  int64_t all_sockets_ = 0;  // peak, of all kinds
  int64_t samples_ = 0;
  int64_t socket_bytes_ = 0;  // peak
  bool overdrawn_ = false;    // socket bytes and other memory together exceeded the limit
  bool pool_full_ = false;   // in this episode
  int64_t dropped_ = 0;      // messages, before this episode
  int64_t err_mark_ = 0;  // where this run's part of err_ begins
  int64_t cpu_ns_ = 0;
  bool ended_ = false;
};

}  // namespace myograde::server
