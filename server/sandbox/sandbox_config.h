// configs/sandbox/*.json: settings of the two kinds of sandboxes, apart from the budgets of a
// track, and the filter of system calls that follows from them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde::server {

struct PolicySandboxConfig {
  std::vector<std::string> denied_system_calls;         // fail with EPERM
  std::vector<std::string> unimplemented_system_calls;  // fail with ENOSYS
  std::vector<int> socket_families;                     // allowed AF_* values
  int64_t sockets = 0;       // UDP and TCP sockets in use at one time, including the bridge's
  int64_t all_sockets = 0;   // open at one time, of all kinds
  double cpu_refresh_s = 0;  // s between samples of the CPU time and of other limits
  double kill_s = 0;         // s for a killed sandbox to be gone
  double farewell_s = 0;     // s for a policy to exit by itself after its last episode
};

struct SimSandboxConfig {
  std::vector<std::string> allowed_system_calls;  // once its model is loaded
  int64_t memory_bytes = 0;
  int64_t tasks = 0;         // processes and threads of its sandbox
  int64_t open_files = 0;
  double silence_s = 0;      // s without a message before the simulator counts as hung
  double lease_slack_s = 0;  // s above the lease's wall time
  int64_t log_bytes = 0;     // largest packed size of an episode's log
};

struct SandboxConfig {
  PolicySandboxConfig policy;
  SimSandboxConfig sim;
};

// Reads policy.json and sim.json in `config_dir`/sandbox. An error names the file, the key and the
// problem.
absl::StatusOr<SandboxConfig> LoadSandboxConfig(const std::string& config_dir);

// A program for bubblewrap's --seccomp: a memory file with BPF, positioned at its start. Allows
// what the config does not deny, but for what README.md says no config can allow.
// InvalidArgumentError names an unknown system call.
absl::StatusOr<Fd> MakeSeccompFilter(const PolicySandboxConfig& config);

}  // namespace myograde::server
