#include "server/executor/local/local_executor.h"

#include <filesystem>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"
#include "server/runner/runner_process.h"

namespace myograde::server {

namespace fs = std::filesystem;

absl::StatusOr<std::unique_ptr<Runner>> LocalExecutor::Start(const LeaseOrder& unclaimed,
                                                             const LeaseSubject&) {
  LeaseOrder order = unclaimed;
  RETURN_IF_ERROR(slots_.Claim(order));
  std::error_code error;
  fs::remove_all(order.work_dir, error);
  if (!fs::create_directory(order.work_dir, error)) {
    return absl::UnavailableError(
        absl::StrCat(order.work_dir, ": can't be made: ", error.message()));
  }
  fs::permissions(order.work_dir, fs::perms::owner_all, error);
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

void LocalExecutor::CleanUp(const std::string& work_dir) {
  std::error_code error;
  fs::remove_all(work_dir, error);
  // Logged and left: the daemon's next start tries again.
  if (error) spdlog::warn("{}: can't be removed: {}", work_dir, error.message());
}

}  // namespace myograde::server
