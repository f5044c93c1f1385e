#include "protocol/base/spawn.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>

#include <absl/cleanup/cleanup.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"

namespace myograde {
namespace {

constexpr absl::Duration kLookEvery = absl::Milliseconds(5);

absl::Status Failed(absl::string_view what, int error) {
  return absl::InternalError(absl::StrCat("can't ", what, ": ", std::strerror(error)));
}

void PlaceStreams(const SpawnOrder& order, posix_spawn_file_actions_t& actions) {
  if (order.in < 0) {
    ::posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  } else {
    ::posix_spawn_file_actions_adddup2(&actions, order.in, STDIN_FILENO);
  }
  if (order.out >= 0) ::posix_spawn_file_actions_adddup2(&actions, order.out, STDOUT_FILENO);
  if (order.err >= 0) ::posix_spawn_file_actions_adddup2(&actions, order.err, STDERR_FILENO);
  ::posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
}

void SetOwnGroupAndSignals(posix_spawnattr_t& attributes) {
  sigset_t signals;
  sigemptyset(&signals);
  ::posix_spawnattr_setsigmask(&attributes, &signals);
  for (int signal : {SIGINT, SIGTERM, SIGPIPE, SIGHUP, SIGCHLD}) sigaddset(&signals, signal);
  ::posix_spawnattr_setsigdefault(&attributes, &signals);
  ::posix_spawnattr_setpgroup(&attributes, 0);
  ::posix_spawnattr_setflags(
      &attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
}

}  // namespace

absl::StatusOr<Pipe> MakePipe() {
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) return Failed("make a pipe", errno);
  Pipe pipe = {Fd(ends[0]), Fd(ends[1])};
  for (Fd* end : {&pipe.read, &pipe.write}) {
    if (end->get() > STDERR_FILENO) continue;
    *end = Fd(::fcntl(end->get(), F_DUPFD_CLOEXEC, STDERR_FILENO + 1));
    if (!end->valid()) return Failed("move a pipe", errno);
  }
  return pipe;
}

absl::StatusOr<Pipe> MakeOutputPipe() {
  absl::StatusOr<Pipe> pipe = MakePipe();
  if (pipe.ok()) ::fcntl(pipe->read.get(), F_SETFL, O_NONBLOCK);
  return pipe;
}

std::vector<char*> ExecVector(std::vector<std::string>& words) {
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  return pointers;
}

absl::StatusOr<pid_t> Spawn(SpawnOrder order) {
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawnattr_init(&attributes);
  const absl::Cleanup destroy = [&] {
    ::posix_spawn_file_actions_destroy(&actions);
    ::posix_spawnattr_destroy(&attributes);
  };
  PlaceStreams(order, actions);
  SetOwnGroupAndSignals(attributes);
  pid_t pid = -1;
  std::vector<char*> variables = ExecVector(order.environment);
  const int error = ::posix_spawn(&pid, order.program.c_str(), &actions, &attributes,
                                  ExecVector(order.words).data(),
                                  order.environment.empty() ? environ : variables.data());
  if (error != 0) return Failed(absl::StrCat("start ", order.program), error);
  if (order.nice != 0) ::setpriority(PRIO_PROCESS, static_cast<id_t>(pid), order.nice);
  return pid;
}

bool EndsWithin(pid_t child, absl::Duration timeout) {
  const Deadline deadline(timeout);
  const Fd handle(static_cast<int>(::syscall(SYS_pidfd_open, child, 0)));
  while (true) {
    siginfo_t end = {};
    const int looked = ::waitid(P_PID, static_cast<id_t>(child), &end, WEXITED | WNOHANG | WNOWAIT);
    if (looked == 0 && end.si_pid == child) return true;
    if (deadline.over()) return false;
    // Without a pidfd, when no descriptor is left, polls from time to time.
    pollfd entry = {handle.get(), POLLIN, 0};
    const absl::Duration wait =
        handle.valid() ? deadline.left() : std::min(deadline.left(), kLookEvery);
    const timespec most = absl::ToTimespec(wait);
    ::ppoll(&entry, 1, &most, nullptr);
  }
}

}  // namespace myograde
