// One run of a policy: its sandbox from start to end, what it used, and the
// ruling on its fault.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/tracks/episode_facts.h"
#include "protocol/base/fd.h"
#include "protocol/lease/lease.h"
#include "server/runner/log_keeper.h"
#include "server/base/output_tail.h"
#include "server/sandbox/policy_sandbox.h"
#include "server/sandbox/process_tree.h"

namespace myograde::server {

// What all runs of a lease share.
struct LeaseContext {
  const LeaseOrder& order;
  const SandboxConfig& config;
  const std::string bin_dir;
  const Stage& stage;
  const EtcFiles& etc;
  LogKeeper* logs = nullptr;           // null: no logs are kept
  const std::vector<Fd>& replays;      // the files of LeaseOrder::replay, opened
};

class PolicyRun {
 public:
  // Builds the sandbox of run `number` of the lease, in which nothing of the
  // participant's begins before Begin(). `bridge_socket` becomes the bridge's.
  // The tails outlive the run. An error is the grader's.
  static absl::StatusOr<std::unique_ptr<PolicyRun>> Prepare(const LeaseContext& context,
                                                            int number, Fd bridge_socket,
                                                            OutputTail& out, OutputTail& err);
  ~PolicyRun();

  void Begin() { sandbox_->Release(); }

  // Descriptors to wait on for POLLIN, -1 once they ended.
  int stdout_fd() const { return stdout_.get(); }
  int stderr_fd() const { return stderr_.get(); }

  // True once nothing of its sandbox runs any more; never blocks.
  bool Ended() { return sandbox_->Ended(); }

  // Takes what the policy printed. Bounded work for each call.
  void DrainOutput();

  // Takes down how full its scratch folders are and how many sockets it has. Cheap.
  // More than it may have ends it at once.
  void Look();

  // What was lost until now was not what a deadline of the next episode waits for.
  void EpisodeOver();

  // CPU time of everything in the sandbox until now, never less than before.
  // `by_chance`: nobody in it could foresee this moment.
  int64_t CpuNs(bool by_chance = false);
  // All in the sandbox, as of the last reading of its CPU time where that is made of looks.
  std::vector<pid_t> Processes() const;
  int64_t peak_memory_bytes() const { return group_->peak_memory_bytes(); }

  // Ends the run and judges the fault that the simulator saw: what the kernel
  // counted may be the cause of it.
  FaultEvidence Rule(FaultEvidence seen);

  // Kills all of it. False: something could not be killed in kill_s, which takes nothing from
  // how the run ended; whoever holds the run looks at Gone() then.
  bool End();
  // After End(): true once nothing of it is left. Never blocks.
  bool Gone();

 private:
  PolicyRun(const LeaseContext& context, OutputTail& out, OutputTail& err)
      : context_(context), out_(out), err_(err) {}
  bool KernelCause(FaultEvidence& evidence) const;
  // Has what its sockets hold count as its memory.
  void CountSocketBytes();
  void ExcuseLostMessages(FaultEvidence& evidence) const;

  const LeaseContext& context_;
  OutputTail& out_;
  OutputTail& err_;
  // In this order: the sandbox goes before its group, both before the mount.
  std::string scratch_;
  std::unique_ptr<ControlGroup> group_;
  std::unique_ptr<Sandbox> sandbox_;
  std::optional<ProcessTree> tree_;  // where no control group counts CPU time
  Fd stdout_;
  Fd stderr_;
  ScratchUsage disk_;
  int64_t sockets_ = 0;      // the most that were seen
  int64_t all_sockets_ = 0;  // ... of all kinds
  int64_t looks_ = 0;
  int64_t socket_bytes_ = 0;  // the most that were seen
  bool overdrawn_ = false;    // these and the rest were more than its memory
  bool pool_full_ = false;   // seen in this episode
  int64_t dropped_ = 0;      // messages, before this episode
  int64_t err_mark_ = 0;  // err_ belongs to this run from here on
  int64_t cpu_ns_ = 0;
  bool ended_ = false;
};

}  // namespace myograde::server
