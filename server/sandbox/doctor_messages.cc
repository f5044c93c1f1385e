// How long a message between two processes takes.
#include <sched.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <set>

#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>
#include <absl/strings/str_join.h>

#include "protocol/base/clock.h"
#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "server/sandbox/doctor_host.h"

namespace myograde::server {
namespace {

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
    const std::string state = ReadFile(entry.path().string()).value_or("");
    // The mitigations that cost at each entry into the kernel or each process switch.
    for (const char* known : {"Safe RET", "Retpolines", "PTI", "IBRS", "IBPB", "untrained return",
                              "Clear CPU buffers", "prctl and seccomp"}) {
      if (absl::StrContains(state, known)) active.insert(known);
    }
  }
  return absl::StrJoin(active, ", ");
}

}  // namespace

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
    return Poorer(name, "no two processes could be made to measure it",
                  "how fast steps are graded is not known",
                  "make room for one more process of this user");
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

}  // namespace myograde::server
