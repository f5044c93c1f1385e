// A lease as its caller sees it: one `myograde-runner` process whose records arrive on a pipe. Used
// by the daemon's poll loop and by `myograde local`.
//
//   absl::StatusOr<std::unique_ptr<RunnerProcess>> runner = RunnerProcess::Start(order);
//   while (!(*runner)->finished()) {
//     poll(stdout_fd and stderr_fd of all runners, timeout);
//     auto records = (*runner)->Read();             // never blocks
//     if (!records.ok()) (*runner)->Kill();         // the grader's fault, see status
//     ...
//   }
//
// The runner and everything it started end when Kill() is called, when this object is destroyed, or
// when the calling process dies.
#pragma once

#include <sys/types.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "protocol/lease/lease.h"
#include "server/base/child_process.h"
#include "server/runner/runner.h"

namespace myograde::server {

class RunnerProcess : public Runner {
 public:
  // Writes the order to `order.work_dir`/order.json (0600; the folder must exist) and starts the
  // runner on it in its own process group. NotFoundError if the program or the folder is missing,
  // InternalError if the process can't be started. Don't use in a process that ignores SIGCHLD.
  static absl::StatusOr<std::unique_ptr<RunnerProcess>> Start(const LeaseOrder& order);
  // The same of another program of the grader's, which takes the same words and prints records too.
  // `text`: its order, instead.
  static absl::StatusOr<std::unique_ptr<RunnerProcess>> Start(const LeaseOrder& order,
                                                              const std::string& program,
                                                              const std::string& text);

  // Kills what is still running.
  ~RunnerProcess() override;
  RunnerProcess(const RunnerProcess&) = delete;
  RunnerProcess& operator=(const RunnerProcess&) = delete;

  int stdout_fd() const override { return stdout_.get(); }
  int stderr_fd() const override { return child_.err_fd(); }
  absl::StatusOr<std::vector<LeaseRecord>> Read() override;
  bool finished() override { return dead() && !stdout_.valid(); }
  bool dead() override { return dead_ = child_.Look(); }
  void AskToEnd() override;
  // Its children have asked the kernel to be killed when it dies, and theirs likewise.
  void KillNow() override { child_.KillNow(); }
  // CPU seconds are known once it is dead.
  RunnerSite site() const override { return {.node = "", .job = "", .cpu_s = child_.cpu_s()}; }
  pid_t pid() const override { return child_.pid(); }
  // 0 before.
  int wait_status() const override { return dead_ ? child_.wait_status() : 0; }
  std::string stderr_tail() const override { return child_.said(); }

  // Ends the lease: asks the runner to clean up, and kills it with everything it started if it
  // takes longer than kCleanUpGrace. Returns within 1 s, with the process reaped. Safe at any time
  // and more than once.
  void Kill();

 private:
  RunnerProcess(std::string lease, ChildProcess child, Fd lifeline, Fd records)
      : lease_(std::move(lease)),
        child_(std::move(child)),
        lifeline_(std::move(lifeline)),
        stdout_(std::move(records)) {}
  absl::Status DrainStdout(std::vector<LeaseRecord>& records);

  const std::string lease_;
  ChildProcess child_;
  Fd lifeline_;  // the runner's stdin: its end tells the runner that the caller is gone
  Fd stdout_;
  bool saw_end_ = false;
  bool dead_ = false;
  std::string line_;  // an incomplete record
};

}  // namespace myograde::server
