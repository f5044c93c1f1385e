// A lease as its caller sees it: an order, and a runner whose records arrive on a pipe. Used by the
// daemon's poll loop, by its self-test, by `myograde local` and by replays.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "protocol/lease/lease.h"
#include "server/base/child_process.h"

namespace myograde::server {

// Episodes `first` to `last` of an evaluation. REQUIRES: `seeds` covers them.
std::vector<EpisodeOrder> EpisodesOf(const TrackConfig& track, const std::vector<uint64_t>& seeds,
                                     int64_t first, int64_t last);

// `id` appears in messages and in the names of temporary files.
LeaseOrder MakeLeaseOrder(std::string id, const TrackConfig& track,
                          std::vector<EpisodeOrder> episodes, const LeaseProgram& program,
                          const LeasePlace& place);

// Tests use fakes.
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

  // False while it waits on another host for a processor: its silence means nothing yet, and none
  // of its lease's time passes.
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

// One `myograde-runner` process. It and everything it started end when Kill() is called, when this
// object is destroyed, or when the calling process dies.
class RunnerProcess : public Runner {
 public:
  // Writes the order to `order.work_dir`/order.json (0600; the folder must exist) and starts the
  // runner on it in its own process group. NotFoundError if the program or the folder is missing,
  // InternalError if the process can't be started. Don't use in a process that ignores SIGCHLD.
  static absl::StatusOr<std::unique_ptr<RunnerProcess>> Start(const LeaseOrder& order);

  // A process that was started, for the constructor.
  struct Started {
    std::string lease;
    ChildProcess child;
    Fd lifeline;  // the runner's stdin: its end tells the runner that the caller is gone
    Fd records;
  };
  // Starts `program` of the grader's with the order `text`, as Start does the runner.
  static absl::StatusOr<Started> Launch(const LeaseOrder& order, const std::string& program,
                                        const std::string& text);
  explicit RunnerProcess(Started started) : started_(std::move(started)) {}

  // Kills what is still running.
  ~RunnerProcess() override;
  RunnerProcess(const RunnerProcess&) = delete;
  RunnerProcess& operator=(const RunnerProcess&) = delete;

  int stdout_fd() const override { return started_.records.get(); }
  int stderr_fd() const override { return started_.child.err_fd(); }
  absl::StatusOr<std::vector<LeaseRecord>> Read() override;
  bool finished() override { return dead() && !started_.records.valid(); }
  bool dead() override { return dead_ = started_.child.Look(); }
  void AskToEnd() override;
  // Its children have asked the kernel to be killed when it dies, and theirs likewise.
  void KillNow() override { started_.child.KillNow(); }
  // CPU seconds are known once it is dead.
  RunnerSite site() const override { return {.cpu_s = started_.child.cpu_s()}; }
  pid_t pid() const override { return started_.child.pid(); }
  // 0 before.
  int wait_status() const override { return dead_ ? started_.child.wait_status() : 0; }
  std::string stderr_tail() const override { return started_.child.said(); }

  // Ends the lease: asks the runner to clean up, and kills it with everything it started if it
  // takes longer than kCleanUpGrace. Returns within 1 s, with the process reaped. Safe at any time
  // and more than once.
  void Kill();

 private:
  Started started_;
  bool saw_end_ = false;
  bool dead_ = false;
  std::string line_;  // an incomplete record
};

}  // namespace myograde::server
