// What this host gives to MyoGrade, tried out rather than looked up.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/lease/track_config.h"

namespace myograde::server {

// kDegraded: everything works, at the cost that the check names. kMissing:
// something that grading needs does not work.
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
  // Whose budgets a sandbox gets; empty: no track can be read.
  std::optional<TrackConfig> track;
  std::map<std::string, std::string> runtimes;  // name to host folder
  int64_t uid_base = 0;   // of the slots, where root runs them
  int slots = 1;
  int64_t submission_bytes = 0;  // largest that the data folder must take
};

// Makes every check, in a fixed order; none stops another and each has a
// deadline. Starts child processes and real sandboxes; changes neither the
// cache nor the data folder. Takes seconds. REQUIRES: a single thread.
std::vector<Check> ExamineHost(const DoctorOptions& options);

// {"policy": ..., "simulator": ..., "staged": ...}: the sandboxes that a lease
// of `options.track` would get on this host, with the system calls that the
// policy's may not make; "staged" gives the host's folder for each source that
// the runner moves first. COMMAND stands for the submission's command.
// InternalError says why none can be made.
absl::StatusOr<nlohmann::json> DescribeSandboxes(const DoctorOptions& options);

// Sends a datagram to LCM's multicast group and waits until it comes back, 2 s
// at most. What ExamineHost runs inside the sandbox, through
// `myograde doctor --probe-bus`. Returns the exit code; says why on stderr.
int ProbeBus();

}  // namespace myograde::server
