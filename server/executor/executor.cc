#include "server/executor/executor.h"

#include <filesystem>

#include <absl/status/status.h>
#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

absl::Status NoCluster() {
  return absl::FailedPreconditionError(
      "leases run only on this host: server.json names no cluster (\"executor\")");
}

}  // namespace

void Executor::CleanUp(const std::string& work_dir) {
  std::error_code error;
  fs::remove_all(work_dir, error);
  if (error) spdlog::warn("{}: can't be removed: {}", work_dir, error.message());
}

absl::Status Executor::MakeWorkDir(const std::string& path) {
  std::error_code error;
  fs::remove_all(path, error);
  if (!fs::create_directory(path, error)) {
    return absl::UnavailableError(absl::StrCat(path, ": can't be created: ", error.message()));
  }
  fs::permissions(path, fs::perms::owner_all, error);
  return absl::OkStatus();
}

absl::Status Executor::Drain(const std::string&, const std::string&) { return NoCluster(); }

absl::Status Executor::Admit(const std::string&) { return NoCluster(); }

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

}  // namespace myograde::server
