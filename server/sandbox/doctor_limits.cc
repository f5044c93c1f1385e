// Whether all slots together can exhaust what the kernel shares among all processes.
#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

#include <sstream>
#include <string>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include "protocol/base/file.h"
#include "server/sandbox/child.h"
#include "server/sandbox/doctor_host.h"
#include "server/sandbox/network.h"
#include "server/sandbox/sandbox_config.h"

namespace myograde::server {
namespace {

// The largest datagram; the kernel accepts one whenever a buffer is not full yet.
constexpr int64_t kDatagramBytes = 65536;
// SCM_MAX_FD: descriptors in one message.
constexpr int64_t kDescriptorsOfAMessage = 253;

std::string MiB(int64_t bytes) {
  return absl::StrFormat("%.0f MiB", static_cast<double>(bytes) / 1048576);
}

// The number at `index` in a kernel file; 0 if there is none.
int64_t Setting(const char* path, int index) {
  std::istringstream file(ReadFile(path).value_or(""));
  int64_t value = 0;
  for (int i = 0; i <= index; ++i) {
    if (!(file >> value)) return 0;
  }
  return value;
}

// Tried in a child, as an ordinary user can create networks only in a user namespace.
bool CanBoundBuffers() {
  return RunInChild(
             [] {
               if (geteuid() != 0 && unshare(CLONE_NEWUSER) != 0) return 1;
               const absl::StatusOr<BusNetwork> network = BusNetwork::Make();
               return network.ok() && network->bounded() ? 0 : 1;
             },
             kQuick)
             .exit_code == 0;
}

}  // namespace

Check JudgeSocketMemory(const SocketMemory& memory) {
  const char name[] = "socket_memory";
  const int64_t all = memory.slots * memory.sockets;
  const int64_t udp = all * (memory.usual_buffer + kDatagramBytes);
  const int64_t tcp = all * 2 * kStreamBufferBytes;
  const std::string found = absl::StrCat(
      "policies on ", memory.slots, memory.slots == 1 ? " slot" : " slots", " can fill ", MiB(udp),
      " of the ", MiB(memory.udp_total), " that all UDP sockets of the host may hold",
      memory.bounded ? absl::StrCat(", and ", MiB(tcp), " of ", MiB(memory.tcp_total), " of TCP's")
                     : "; of TCP's memory without a bound");
  const char costs[] =
      "hostile policies together can fill memory that the whole host shares: messages of other "
      "leases get lost, and their episodes are played again";
  if (!memory.bounded) {
    return Poorer(name, found, costs,
                  "let this user write /proc/sys/net in network namespaces of its own; in a "
                  "container, start it privileged");
  }
  if (udp <= memory.udp_total / 2 && tcp <= memory.tcp_total / 2) return Fine(name, found);
  return Poorer(name, found, costs,
                "raise the last number of sysctl net.ipv4.udp_mem and net.ipv4.tcp_mem, or lower "
                "net.core.rmem_default, sockets in sandbox/policy.json, or slots in server.json");
}

Check JudgeFlight(const FlightLimits& limits) {
  const char name[] = "descriptors";
  if (limits.own < 0) {
    return Fine(name, "those in flight between processes are counted for each slot's user");
  }
  // All tasks may pass the kernel's check of the limit at the same moment.
  const int64_t flight =
      limits.open_files + limits.slots * limits.tasks * kDescriptorsOfAMessage;
  const std::string found =
      absl::StrCat("this user's processes may open ", limits.own, " files; policies on ",
                   limits.slots, limits.slots == 1 ? " slot" : " slots", " can have ", flight,
                   " descriptors in flight");
  if (limits.own >= flight) return Fine(name, found);
  return Poorer(name, found,
                "they count for the user: a policy that keeps very many in flight makes other "
                "leases end as faults of the grader",
                absl::StrCat("raise the hard limit of open files to ", flight,
                             " (LimitNOFILE= of a systemd unit, ulimit -Hn), lower open_files or "
                             "tasks in the tracks' budgets, or start the daemon as root"));
}

void CheckSharedLimits(const DoctorOptions& options, std::vector<Check>& checks) {
  const absl::StatusOr<SandboxConfig> config = LoadSandboxConfig(options.config_dir);
  // Mistakes in the configs are covered by another check.
  if (!config.ok() || !options.track.has_value()) return;
  const int64_t page = sysconf(_SC_PAGESIZE);
  checks.push_back(JudgeSocketMemory({options.slots, config->policy.sockets,
                                      Setting("/proc/sys/net/core/rmem_default", 0),
                                      Setting("/proc/sys/net/ipv4/udp_mem", 2) * page,
                                      Setting("/proc/sys/net/ipv4/tcp_mem", 2) * page,
                                      CanBoundBuffers()}));
  rlimit files = {};
  getrlimit(RLIMIT_NOFILE, &files);
  const int64_t own = geteuid() == 0 || files.rlim_max == RLIM_INFINITY
                          ? -1
                          : static_cast<int64_t>(files.rlim_max);
  checks.push_back(JudgeFlight(
      {options.slots, options.track->budgets.open_files, options.track->budgets.tasks, own}));
}

}  // namespace myograde::server
