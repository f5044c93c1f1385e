#include "server/daemon/ports.h"

#include <filesystem>
#include <fstream>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "server/runner/output_tail.h"
#include "server/runner/runner_process.h"
#include "server/sandbox/users.h"

namespace myograde::server {

namespace fs = std::filesystem;

absl::StatusOr<std::unique_ptr<Runner>> SystemProcesses::Start(const LeaseOrder& order) {
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

std::map<int64_t, std::string> SystemProcesses::ProcessesOf(int64_t first, int64_t count) {
  std::map<int64_t, std::string> found;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator("/proc", error)) {
    const std::string pid = entry.path().filename();
    if (pid.find_first_not_of("0123456789") != std::string::npos) continue;
    // The file's owner says nothing: that of a process that can't be looked into is root.
    std::ifstream status(entry.path() / "status");
    std::string name, state;
    int64_t user = -1;
    for (std::string key; user < 0 && status >> key;) {
      if (key == "Name:") status >> name;
      if (key == "State:") status >> state;
      if (key == "Uid:") status >> user;
    }
    if (state == "Z" || state == "X") continue;  // dead, and not collected yet
    int64_t index = user - first;
    if (index >= kSimUsers) index -= kSimUsers;
    if (index < 0 || index >= count) continue;
    std::string& words = found[first + index];
    absl::StrAppend(&words, words.empty() ? "" : ", ", pid, " (", PrintableUtf8(name), ", state ",
                    state, ")");
  }
  return found;
}

void SystemProcesses::CleanUp(const std::string& work_dir) {
  std::error_code error;
  fs::remove_all(work_dir, error);
  // Told and left: the next start of the daemon tries again.
  if (error) spdlog::warn("{}: can't be removed: {}", work_dir, error.message());
}

}  // namespace myograde::server
