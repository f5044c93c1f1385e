#include "server/executor/local/local_executor.h"

#include "protocol/base/status_macros.h"
#include "server/runner/runner_process.h"

namespace myograde::server {

absl::StatusOr<std::unique_ptr<Runner>> LocalExecutor::Start(const LeaseOrder& unclaimed,
                                                             const LeaseSubject&) {
  LeaseOrder order = unclaimed;
  RETURN_IF_ERROR(slots_.Claim(order));
  RETURN_IF_ERROR(MakeWorkDir(order.work_dir));
  absl::StatusOr<std::unique_ptr<RunnerProcess>> runner = RunnerProcess::Start(order);
  if (!runner.ok()) {
    CleanUp(order.work_dir);
    return runner.status();
  }
  return *std::move(runner);
}

std::map<int, std::string> LocalExecutor::ProcessesOf(int first, int count) {
  return slots_.Find(first, count);
}

}  // namespace myograde::server
