// A lease's runner, as its caller reads from it and stops it. RunnerProcess is the real one; tests
// use fakes.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/lease/lease.h"

namespace myograde::server {

// Where a runner is, and what it used: for people and their accounts, not for any decision.
struct RunnerSite {
  std::string node = {};                // "": this host
  std::string job = {};                 // the cluster's name for it, such as 1234; "": no job
  double cpu_s = 0;                     // of all processes of the lease; 0: not known (yet)
  std::optional<double> energy_j = {};  // of the job, where the cluster measures it
};

class Runner {
 public:
  // How long a runner that was asked to end may clean up before it is killed.
  static constexpr absl::Duration kCleanUpGrace = absl::Milliseconds(700);

  virtual ~Runner() = default;

  // Descriptors to poll for POLLIN; -1 once the stream has ended.
  virtual int stdout_fd() const = 0;
  virtual int stderr_fd() const = 0;

  // The records that arrived since the last call, in order; empty if none. Drains stderr too. Never
  // blocks. DataLossError: the runner printed something that is not a record, or records after its
  // end record; records parsed before it in the same call are dropped, so treat the lease as lost
  // and end it.
  virtual absl::StatusOr<std::vector<LeaseRecord>> Read() = 0;

  // True once the process is dead and Read() has reached the end of its records.
  virtual bool finished() = 0;

  // True once the process is reaped. Never blocks.
  virtual bool dead() = 0;

  // Asks the runner to end its lease and clean up. Never blocks; safe at any time.
  virtual void AskToEnd() = 0;

  // Kills the runner and everything it started. Never blocks; safe at any time.
  virtual void KillNow() = 0;

  // False while it waits on another host for a processor: its silence means nothing yet, and none of
  // its lease's time passes.
  virtual bool begun() const { return true; }

  // Why the lease ended, or will never end, though it is nobody's fault: its node was lost, its job
  // preempted, the way back from there cut. "": none of this. The lease may be played again.
  virtual std::string lost() const { return ""; }

  // Where it runs.
  virtual RunnerSite site() const { return {}; }

  // Its process on this host; 0: it has none, and no descriptors either.
  virtual pid_t pid() const = 0;

  // The runner's wait status, see waitpid(2); valid once dead().
  virtual int wait_status() const = 0;

  // The last 4 KiB of the runner's stderr, as valid UTF-8.
  virtual std::string stderr_tail() const = 0;
};

}  // namespace myograde::server
