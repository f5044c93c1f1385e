// The doctor's checks that need no sandbox.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <absl/time/time.h>

#include "server/sandbox/doctor.h"

namespace myograde::server {

struct ChildEnd {
  bool in_time = false;  // it ended by itself before the deadline
  int exit_code = -1;    // 128 + signal if killed by one; -1: not started, or late
  std::string output;    // the first 1 MiB of stdout and stderr combined
};

// Runs `work` in a fork of this process, with stdin at end of file; its result is the exit code.
// Kills the child's process group at `timeout`. REQUIRES: a single thread.
ChildEnd RunInChild(const std::function<int()>& work, absl::Duration timeout);

// The exit code of a child's work; tells an error on stderr.
int TrialExit(const absl::Status& status);

// The last two non-empty lines, joined by "; ", without control characters.
std::string LastWords(const std::string& output);

// A check with the state kOk, kDegraded or kMissing.
inline Check Fine(std::string name, std::string found) {
  return {std::move(name), CheckState::kOk, std::move(found), "", ""};
}
inline Check Poorer(std::string name, std::string found, std::string costs, std::string todo) {
  return {std::move(name), CheckState::kDegraded, std::move(found), std::move(costs),
          std::move(todo)};
}
inline Check Missing(std::string name, std::string found, std::string costs, std::string todo) {
  return {std::move(name), CheckState::kMissing, std::move(found), std::move(costs),
          std::move(todo)};
}

// Time limit of a program with next to nothing to do.
inline constexpr absl::Duration kQuick = absl::Seconds(10);
inline constexpr size_t kMostPrinted = 1 << 20;  // bytes, by a program

// System, Python and runtimes, machine, programs, and whether pictures and films of episodes can be
// made here.
void CheckHost(const DoctorOptions& options, std::vector<Check>& checks);
Check CheckMujoco(const DoctorOptions& options);
Check CheckModels(const DoctorOptions& options);

// The kernel resources that all leases of a host share, and the limits that keep one lease from
// exhausting them: one check for each of the two below.
void CheckSharedLimits(const DoctorOptions& options, std::vector<Check>& checks);

// The most that the sockets of all slots together can hold, and what the kernel allows for the
// whole host. In bytes.
struct SocketMemory {
  int64_t slots = 1;
  int64_t sockets = 0;       // per sandbox
  int64_t usual_buffer = 0;  // net.core.rmem_default
  int64_t udp_total = 0;     // net.ipv4.udp_mem, the last
  int64_t tcp_total = 0;     // net.ipv4.tcp_mem, the last
  bool bounded = false;      // TCP buffers are bounded, see BusNetwork::bounded()
};
Check JudgeSocketMemory(const SocketMemory& memory);

// Descriptors in flight between processes of the daemon's user.
struct FlightLimits {
  int64_t slots = 1;
  int64_t open_files = 0;  // per process of a policy
  int64_t tasks = 0;       // per policy
  int64_t own = 0;         // how many files this user's own processes may open; -1: unlimited
};
Check JudgeFlight(const FlightLimits& limits);

// The cost of a message between two processes. A graded step is a handful of messages besides its
// physics, so this cost determines the step's overhead, and it varies between machines more than
// the speed of the physics does.
Check CheckMessages();

// The round-trip time of a message to another process on the same processor: the smallest mean of
// several batches. nullopt if two processes can't be created. Takes about 50 ms. REQUIRES: a single
// thread.
std::optional<absl::Duration> MeasureMessages();

// What it means for a step. `mitigations`: the kernel's mitigations of processor vulnerabilities.
Check JudgeMessages(std::optional<absl::Duration> there_and_back, const std::string& mitigations);

}  // namespace myograde::server
