// What the doctor tries out beside building sandboxes: a child with a deadline, how long a message
// between two processes takes, and the bus.
#include "server/sandbox/doctor_host.h"

#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <set>

#include <absl/strings/ascii.h>
#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>
#include <absl/strings/str_join.h>
#include <absl/strings/str_split.h>
#include <absl/strings/string_view.h>

#include "protocol/base/clock.h"
#include "protocol/base/fd.h"
#include "protocol/base/spawn.h"
#include "protocol/bridge/bus.h"
#include "protocol/policy/channels.h"
#include "server/base/child_process.h"
#include "server/base/counted.h"
#include "server/sandbox/kernel_files.h"
#include "server/sandbox/network.h"
#include "server/sandbox/sandbox_config.h"

namespace myograde::server {
namespace {

constexpr int kPollMs = 10;

[[noreturn]] void BecomeChild(const std::function<int()>& work, int output) {
  setpgid(0, 0);
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const int nothing = open("/dev/null", O_RDONLY);
  dup2(nothing, STDIN_FILENO);
  dup2(output, STDOUT_FILENO);
  dup2(output, STDERR_FILENO);
  // Skips this process' exit handlers and buffers, which are the parent's.
  _exit(work());
}

constexpr int kBatches = 5;
constexpr int kMessages = 1000;  // per batch
// Messages per graded step: two between simulator, bridge and policy, plus the cost of multicast
// and caches (sim/README.md).
constexpr double kOfAStep = 6;
// Above this, a step (a millisecond of physics) loses a tenth of its time to messages.
constexpr absl::Duration kSlow = absl::Microseconds(15);

void Keep(int processor) {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(processor, &set);
  sched_setaffinity(0, sizeof(set), &set);
}

// Echoes each byte until the other end is closed.
[[noreturn]] void Answer(int socket) {
  char byte;
  while (read(socket, &byte, 1) == 1 && write(socket, &byte, 1) == 1) continue;
  _exit(0);
}

std::optional<absl::Duration> Batch(int socket) {
  const absl::Duration start = SystemClock().Monotonic();
  for (int i = 0; i < kMessages; ++i) {
    char byte = 0;
    if (write(socket, &byte, 1) != 1 || read(socket, &byte, 1) != 1) return std::nullopt;
  }
  return (SystemClock().Monotonic() - start) / kMessages;
}

std::string Mitigations() {
  std::set<std::string> active;
  std::error_code error;
  const char folder[] = "/sys/devices/system/cpu/vulnerabilities";
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    const std::string state = ReadKernelFile(entry.path().string());
    // The mitigations that cost at each entry into the kernel or each process switch.
    for (const char* known : {"Safe RET", "Retpolines", "PTI", "IBRS", "IBPB", "untrained return",
                              "Clear CPU buffers", "prctl and seccomp"}) {
      if (absl::StrContains(state, known)) active.insert(known);
    }
  }
  return absl::StrJoin(active, ", ");
}

int BusComplaint(absl::string_view problem) {
  return TrialExit(absl::InternalError(absl::StrCat("the bus of the sandbox: ", problem)));
}

// The largest datagram; the kernel accepts one whenever a buffer is not full yet.
constexpr int64_t kDatagramBytes = 65536;
// SCM_MAX_FD: descriptors in one message.
constexpr int64_t kDescriptorsOfAMessage = 253;

std::string MiB(int64_t bytes) {
  return absl::StrFormat("%.0f MiB", static_cast<double>(bytes) / 1048576);
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

int TrialExit(const absl::Status& status) {
  if (status.ok()) return 0;
  dprintf(STDERR_FILENO, "%s\n", std::string(status.message()).c_str());
  return 1;
}

ChildEnd RunInChild(const std::function<int()>& work, absl::Duration timeout) {
  ChildEnd end;
  absl::StatusOr<Pipe> output = MakeOutputPipe();
  if (!output.ok()) {
    end.output = std::string(output.status().message());
    return end;
  }
  const pid_t child = fork();
  if (child < 0) {
    end.output = std::string("can't start a process: ") + std::strerror(errno);
    return end;
  }
  if (child == 0) BecomeChild(work, output->write.get());
  setpgid(child, child);  // in both processes, as either may come first
  output->write.reset();

  const Deadline deadline(timeout);
  int status = 0;
  while (!end.in_time && !deadline.over()) {
    pollfd entry = {output->read.get(), POLLIN, 0};
    poll(&entry, 1, kPollMs);
    end.in_time = waitpid(child, &status, WNOHANG) == child;
    Drain(output->read, end.output);  // all that a pipe holds
    end.output.resize(std::min(end.output.size(), kMostPrinted));
  }
  kill(-child, SIGKILL);  // it, or what it left behind
  if (end.in_time) {
    end.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  } else {
    waitpid(child, &status, 0);
  }
  return end;
}

std::string LastWords(const std::string& output) {
  std::string last, words;
  for (absl::string_view line : absl::StrSplit(output, '\n')) {
    line = absl::StripTrailingAsciiWhitespace(line);
    if (line.empty()) continue;
    words = last.empty() ? std::string(line) : absl::StrCat(last, "; ", line);
    last = std::string(line);
  }
  std::replace_if(words.begin(), words.end(), absl::ascii_iscntrl, '?');
  return words;
}

std::optional<absl::Duration> MeasureMessages() {
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0) return std::nullopt;
  Fd here(ends[0]), there(ends[1]);
  cpu_set_t before;
  if (sched_getaffinity(0, sizeof(before), &before) != 0) return std::nullopt;
  Keep(sched_getcpu());
  const pid_t child = fork();
  if (child == 0) {
    here.reset();
    Answer(there.get());
  }
  there.reset();
  std::optional<absl::Duration> best;
  for (int i = 0; child > 0 && i < kBatches; ++i) {
    const std::optional<absl::Duration> one = Batch(here.get());
    if (one.has_value()) best = std::min(best.value_or(*one), *one);
  }
  here.reset();
  if (child > 0) {
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
  }
  sched_setaffinity(0, sizeof(before), &before);
  return best;
}

Check JudgeMessages(std::optional<absl::Duration> there_and_back, const std::string& mitigations) {
  const char name[] = "messages";
  if (!there_and_back.has_value()) {
    return Poorer(name, "could not start two processes to measure it",
                  "the speed of steps is unknown",
                  "allow this user one more process");
  }
  const double us = absl::ToDoubleMicroseconds(*there_and_back);
  const std::string found = absl::StrFormat(
      "%.1f us to another process and back, so about %.0f us of a step%s", us, kOfAStep * us,
      mitigations.empty() ? "" : absl::StrCat("; mitigations: ", mitigations));
  if (*there_and_back <= kSlow) return Fine(name, found);
  return Poorer(name, found, "each step takes longer; results stay the same",
                "grade while nothing else runs, or on a host that changes between processes "
                "faster (sim/README.md)");
}

Check CheckMessages() { return JudgeMessages(MeasureMessages(), Mitigations()); }

int ProbeBus() {
  constexpr auto kPatience = std::chrono::seconds(2);
  constexpr std::string_view kChannel = "MYOGRADE_DOCTOR";
  absl::StatusOr<Bus> one = Bus::Open(kBusUrl, kPatience);
  if (!one.ok()) return BusComplaint(one.status().message());
  absl::StatusOr<Bus> other = Bus::Open(kBusUrl, kPatience);
  if (!other.ok()) return BusComplaint(other.status().message());
  one->Send(kChannel, {});
  const std::optional<Datagram> heard = ParseDatagram(other->Await());
  if (heard && heard->channel == kChannel) return 0;
  return BusComplaint("a datagram did not arrive within 2 s");
}

Check JudgeSocketMemory(const SocketMemory& memory) {
  const char name[] = "socket_memory";
  const int64_t all = memory.slots * memory.sockets;
  const int64_t udp = all * (memory.usual_buffer + kDatagramBytes);
  const int64_t tcp = all * 2 * kStreamBufferBytes;
  const std::string found = absl::StrCat(
      "policies on ", Counted(memory.slots, "slot"), " can fill ", MiB(udp),
      " of the ", MiB(memory.udp_total), " that all UDP sockets of the host may hold",
      memory.bounded ? absl::StrCat(", and ", MiB(tcp), " of ", MiB(memory.tcp_total), " of TCP's")
                     : "; their TCP memory has no bound");
  const char costs[] =
      "hostile policies can together fill memory that the whole host shares: messages of other "
      "leases get lost, and those leases are retried";
  if (!memory.bounded) {
    return Poorer(name, found, costs,
                  "let this user write /proc/sys/net in its own network namespaces; in a "
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
    return Fine(name, "descriptors in flight are counted for each slot's user");
  }
  // All tasks may pass the kernel's check of the limit at the same moment.
  const int64_t flight =
      limits.open_files + limits.slots * limits.tasks * kDescriptorsOfAMessage;
  const std::string found =
      absl::StrCat("this user's processes may open ", limits.own, " files; policies on ",
                   Counted(limits.slots, "slot"), " can have ", flight, " descriptors in flight");
  if (limits.own >= flight) return Fine(name, found);
  return Poorer(name, found,
                "they count for the user: a policy with very many in flight makes other leases "
                "end as faults of the grader",
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
                                      KernelSetting("net/core/rmem_default", 0),
                                      KernelSetting("net/ipv4/udp_mem", 2) * page,
                                      KernelSetting("net/ipv4/tcp_mem", 2) * page,
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
