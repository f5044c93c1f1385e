// A lease on the cluster, as the engine sees it.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "server/executor/slurm/slurm_executor.h"

namespace myograde::server {

class SlurmRunner : public Runner {
 public:
  // `executor` must outlive it.
  SlurmRunner(SlurmExecutor& executor, std::shared_ptr<SlurmExecutor::Attempt> attempt)
      : executor_(executor), attempt_(std::move(attempt)) {}
  // Has the attempt's job ended, if it has not.
  ~SlurmRunner() override { AskToEnd(); }

  int stdout_fd() const override { return -1; }
  int stderr_fd() const override { return -1; }
  absl::StatusOr<std::vector<LeaseRecord>> Read() override;
  bool finished() override;
  // Its node has said its last word, or its job has ended, as the cluster says; or a minute has passed since it was to end, and the
  // executor goes on by itself.
  bool dead() override;
  void AskToEnd() override { executor_.Release(*attempt_); }
  void KillNow() override { AskToEnd(); }
  bool begun() const override;
  std::string lost() const override;
  RunnerSite site() const override;
  bool remote() const override { return true; }
  pid_t pid() const override { return 0; }
  int wait_status() const override;
  std::string stderr_tail() const override;

 private:
  SlurmExecutor& executor_;
  const std::shared_ptr<SlurmExecutor::Attempt> attempt_;
};

}  // namespace myograde::server
