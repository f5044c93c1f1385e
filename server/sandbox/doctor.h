// Examines what this host offers MyoGrade, by trying it out.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/lease/track_config.h"

namespace myograde::server {

// kDegraded: everything works, at the cost that the check names. kMissing: something that grading
// needs does not work.
enum class CheckState { kOk, kDegraded, kMissing };
std::string_view CheckStateName(CheckState state);  // "ok", "degraded", "missing"

struct Check {
  std::string name;   // one word, stable
  CheckState state = CheckState::kOk;
  std::string found;  // a fact
  std::string costs;  // what is lost; "" if ok
  std::string todo;   // how to get it; "" if ok
};

// What to examine. Folders are absolute and may be missing.
struct DoctorOptions {
  std::string bin_dir;
  std::string config_dir;
  std::string cache_dir;
  std::string data_dir;
  // Whose budgets a sandbox gets; unset if no track can be read.
  std::optional<TrackConfig> track;
  std::map<std::string, std::string> runtimes;  // name to host folder
  // Whether the content of a runtime is what it was made with; null: not checked.
  std::function<absl::Status(const std::string& name)> check_runtime = nullptr;
  int64_t uid_base = 0;   // of the slots, if root runs them
  int slots = 1;
  int64_t submission_bytes = 0;  // the largest that the data folder must hold
  int64_t disk_reserve = 0;      // bytes of its disk that uploads and leases leave free
};

// Runs every check, in a fixed order; none stops another and each has a deadline. Starts child
// processes and real sandboxes; changes neither the cache nor the data folder. Takes seconds.
// REQUIRES: a single thread.
std::vector<Check> ExamineHost(const DoctorOptions& options);

// {"policy": ..., "simulator": ..., "staged": ...}: the sandboxes that a lease of `options.track`
// would get on this host, with the system calls that the policy's denies; "staged" maps each path
// that the runner stages to the host's folder. COMMAND stands for the submission's command.
// InternalError says why a sandbox can't be built.
absl::StatusOr<nlohmann::json> DescribeSandboxes(const DoctorOptions& options);

// Sends a datagram to LCM's multicast group and waits at most 2 s for it to come back. ExamineHost
// runs this inside the sandbox, through `myograde doctor --probe-bus`. Returns the exit code;
// explains failures on stderr.
int ProbeBus();

}  // namespace myograde::server
