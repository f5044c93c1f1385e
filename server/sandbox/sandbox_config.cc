#include "server/sandbox/sandbox_config.h"

#include <seccomp.h>
#include <sys/socket.h>

#include <map>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

// For a policy.json without the key.
constexpr int64_t kUsualSockets = 256;
constexpr int64_t kUsualAllSockets = 2048;

// A list of system calls. An empty list or an unknown name is an error, as a filter that lacks a
// call because of a typo looks like any other.
std::vector<std::string> SystemCalls(ConfigReader& reader, const char* key) {
  std::vector<std::string> names = reader.Strings(key);
  if (names.empty()) reader.Fail(key, "must hold at least one system call");
  for (const std::string& name : names) {
    if (IsSystemCall(name)) continue;
    reader.Fail(key,
                absl::StrCat("holds \"", name, "\", which is no system call; see syscalls(2)"));
  }
  return names;
}

absl::StatusOr<PolicySandboxConfig> LoadPolicy(const std::string& path) {
  ASSIGN_OR_RETURN(nlohmann::json json, ReadJsonFile(path));
  ConfigReader reader(json, path);
  PolicySandboxConfig config;
  config.denied_system_calls = SystemCalls(reader, "denied_system_calls");
  config.unimplemented_system_calls = SystemCalls(reader, "unimplemented_system_calls");
  static const std::map<std::string, int> kFamilies = {
      {"unix", AF_UNIX}, {"inet", AF_INET}, {"inet6", AF_INET6}};
  for (const std::string& name : reader.Strings("socket_families")) {
    const auto family = kFamilies.find(name);
    if (family == kFamilies.end()) {
      reader.Fail("socket_families", "must hold only \"unix\", \"inet\" and \"inet6\"");
      break;
    }
    config.socket_families.push_back(family->second);
  }
  config.sockets = reader.Has("sockets") ? reader.Integer("sockets", 16, 65536) : kUsualSockets;
  config.all_sockets =
      reader.Has("all_sockets") ? reader.Integer("all_sockets", 16, 1048576) : kUsualAllSockets;
  config.cpu_refresh_s = reader.Number("cpu_refresh_s", {0.001, 1});
  config.kill_s = reader.Number("kill_s", {1, 60});
  // Absent in files of earlier versions.
  config.farewell_s = reader.Has("farewell_s") ? reader.Number("farewell_s", {0, 10}) : 1;
  RETURN_IF_ERROR(reader.Finish());
  return config;
}

absl::StatusOr<SimSandboxConfig> LoadSim(const std::string& path) {
  ASSIGN_OR_RETURN(nlohmann::json json, ReadJsonFile(path));
  ConfigReader reader(json, path);
  SimSandboxConfig config;
  config.allowed_system_calls = SystemCalls(reader, "allowed_system_calls");
  config.tasks = reader.Integer("tasks", 4, 1000);
  config.memory_bytes = reader.Integer("memory_bytes", 256 << 20, int64_t{1} << 40);
  config.open_files = reader.Integer("open_files", 32, 65536);
  config.silence_s = reader.Number("silence_s", {2, 3600});
  config.lease_slack_s = reader.Number("lease_slack_s", {1, 86400});
  config.log_bytes = reader.Integer("log_bytes", 1 << 20, 256 << 20);
  RETURN_IF_ERROR(reader.Finish());
  return config;
}

}  // namespace

bool IsSystemCall(const std::string& name) {
  return seccomp_syscall_resolve_name(name.c_str()) != __NR_SCMP_ERROR;
}

absl::StatusOr<SandboxConfig> LoadSandboxConfig(const std::string& config_dir) {
  ASSIGN_OR_RETURN(PolicySandboxConfig policy, LoadPolicy(config_dir + "/sandbox/policy.json"));
  ASSIGN_OR_RETURN(SimSandboxConfig sim, LoadSim(config_dir + "/sandbox/sim.json"));
  return SandboxConfig{std::move(policy), std::move(sim)};
}

}  // namespace myograde::server
