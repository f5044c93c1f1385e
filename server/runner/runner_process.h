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
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "protocol/lease/lease.h"
#include "server/base/paths.h"
#include "server/base/output_tail.h"
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
  int stderr_fd() const override { return stderr_.get(); }
  absl::StatusOr<std::vector<LeaseRecord>> Read() override;
  bool finished() override { return dead() && !stdout_.valid(); }
  bool dead() override;
  void AskToEnd() override;
  void KillNow() override;
  // CPU seconds are known once it is dead.
  RunnerSite site() const override { return {.node = "", .job = "", .cpu_s = cpu_s_}; }
  pid_t pid() const override { return pid_; }
  int wait_status() const override { return wait_status_; }
  std::string stderr_tail() const override { return stderr_output_.tail(); }

  // Waits until the process exits, draining nothing; DeadlineExceededError after `timeout`. Returns
  // the wait status of waitpid(2).
  absl::StatusOr<int> Wait(absl::Duration timeout);

  // Ends the lease: asks the runner to clean up, and kills it with everything it started if it
  // takes longer than kCleanUpGrace. Returns within 1 s, with the process reaped. Safe at any time
  // and more than once.
  void Kill();

 private:
  RunnerProcess() : stderr_output_(64 << 10) {}
  void DrainStderr();
  absl::Status DrainStdout(std::vector<LeaseRecord>& records);

  std::string lease_;
  pid_t pid_ = -1;
  bool reaped_ = false;
  bool saw_end_ = false;
  int wait_status_ = 0;
  double cpu_s_ = 0;  // of the runner and all that it waited for
  Fd lifeline_;  // the runner's stdin: its end tells the runner that the caller is gone
  Fd stdout_;
  Fd stderr_;
  std::string line_;    // an incomplete record
  OutputTail stderr_output_;
};

}  // namespace myograde::server
