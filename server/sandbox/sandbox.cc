#include "server/sandbox/sandbox.h"

#include <fcntl.h>
#include <grp.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <thread>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/spawn.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

// Above those that a command is given.
constexpr int kStatusFd = 20;
constexpr int kFilterFd = 21;
constexpr int kGateFd = 22;

// A kind of mount: its name for people, and bubblewrap's option, which takes the source if there is
// one, and the target.
struct KindWords {
  SandboxMount::Kind kind;
  const char* name;
  const char* option;
  bool has_source;
};
constexpr KindWords kKinds[] = {{SandboxMount::Kind::kReadOnly, "read-only", "--ro-bind", true},
                                {SandboxMount::Kind::kWritable, "writable", "--bind", true},
                                {SandboxMount::Kind::kSymlink, "symlink", "--symlink", true},
                                {SandboxMount::Kind::kProc, "proc", "--proc", false},
                                {SandboxMount::Kind::kDev, "dev", "--dev", false},
                                {SandboxMount::Kind::kDevice, "device", "--dev-bind", true},
                                {SandboxMount::Kind::kTmpfs, "tmpfs", "--tmpfs", false},
                                {SandboxMount::Kind::kSealed, "sealed", "--remount-ro", false}};

const KindWords& WordsOf(SandboxMount::Kind kind) {
  return *std::ranges::find(kKinds, kind, &KindWords::kind);
}

std::vector<std::string> Arguments(const SandboxSpec& spec, bool filter) {
  std::vector<std::string> arguments = {
      kBubblewrap,      "--unshare-user", "--unshare-pid", "--unshare-ipc", "--unshare-uts",
      "--unshare-cgroup-try", "--uid",    std::to_string(spec.inner_uid),
      "--gid",          std::to_string(spec.inner_gid),
      "--hostname",     "myograde",       "--new-session", "--die-with-parent",
      "--cap-drop",     "ALL",            "--json-status-fd", std::to_string(kStatusFd)};
  if (spec.as_first) arguments.push_back("--as-pid-1");
  if (spec.held) arguments.insert(arguments.end(), {"--block-fd", std::to_string(kGateFd)});
  // A sandbox with the bus is started in a BusNetwork.
  if (!spec.bus) arguments.push_back("--unshare-net");
  if (filter) arguments.insert(arguments.end(), {"--seccomp", std::to_string(kFilterFd)});
  for (const SandboxMount& mount : spec.mounts) {
    const KindWords& words = WordsOf(mount.kind);
    arguments.emplace_back(words.option);
    if (words.has_source) arguments.push_back(mount.source);
    arguments.push_back(mount.target);
  }
  arguments.insert(arguments.end(), {"--chdir", spec.working_dir, "--clearenv"});
  for (const auto& [name, value] : spec.environment) {
    arguments.insert(arguments.end(), {"--setenv", name, value});
  }
  arguments.push_back("--");
  // The kernel counts a user's processes per user namespace, so a limit set inside counts only the
  // sandbox' own.
  if (spec.tasks > 0) {
    arguments.insert(arguments.end(), spec.prlimit.begin(), spec.prlimit.end());
    arguments.insert(arguments.end(),
                     {absl::StrCat("--nproc=", spec.tasks, ":", spec.tasks), "--"});
  }
  arguments.insert(arguments.end(), spec.command.begin(), spec.command.end());
  return arguments;
}

// What the child needs between fork and exec, prepared before the fork.
struct ChildPlan {
  std::vector<char*> arguments;
  std::vector<SandboxFd> fds;
  std::vector<int> join;
  const SandboxSpec* spec;
  int network;  // to join; -1: bubblewrap creates one
  pid_t parent;
};

// The sandbox' stderr, once it is known.
int complaints = STDERR_FILENO;

[[noreturn]] void Fail(const char* what, int error) {
  dprintf(complaints, "sandbox: %s: %s\n", what, std::strerror(error));
  _exit(126);
}

// Moves each descriptor to its target. All are lifted first, so that none is overwritten before it
// has been moved.
void PlaceDescriptors(const std::vector<SandboxFd>& fds) {
  int lifted[16];
  for (size_t i = 0; i < fds.size(); ++i) {
    lifted[i] = fcntl(fds[i].fd, F_DUPFD, 64);
    if (lifted[i] < 0) Fail("descriptors", errno);
  }
  unsigned int highest = 0;
  bool wanted[32] = {};
  for (size_t i = 0; i < fds.size(); ++i) {
    if (dup2(lifted[i], fds[i].target) < 0) Fail("descriptors", errno);
    if (fds[i].target == STDERR_FILENO) complaints = STDERR_FILENO;
    wanted[fds[i].target] = true;
    highest = std::max(highest, static_cast<unsigned int>(fds[i].target));
  }
  for (unsigned int fd = 0; fd <= highest; ++fd) {
    if (!wanted[fd]) close(static_cast<int>(fd));
  }
  syscall(SYS_close_range, highest + 1, ~0U, 0U);
}

[[noreturn]] void BecomeSandbox(const ChildPlan& plan) {
  for (const SandboxFd& fd : plan.fds) {
    if (fd.target == STDERR_FILENO) complaints = fd.fd;
  }
  for (int fd : plan.join) {
    if (write(fd, "0", 1) != 1) Fail("control group", errno);
  }
  if (plan.network >= 0 && setns(plan.network, CLONE_NEWNET) != 0) {
    Fail("entering the network namespace", errno);
  }
  PlaceDescriptors(plan.fds);
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  signal(SIGPIPE, SIG_DFL);
  if (plan.spec->uid >= 0) {
    const auto id = static_cast<uid_t>(plan.spec->uid);
    if (setgroups(0, nullptr) != 0 || setresgid(id, id, id) != 0 || setresuid(id, id, id) != 0) {
      Fail("taking the slot's uid", errno);
    }
  }
  // After the change of uid, which clears it. This covers bubblewrap itself; its child, in a new
  // session, sets its own.
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != plan.parent) _exit(126);
  for (const SandboxLimit& limit : plan.spec->limits) {
    const rlimit both = {static_cast<rlim_t>(limit.value), static_cast<rlim_t>(limit.value)};
    if (setrlimit(static_cast<__rlimit_resource>(limit.resource), &both) != 0) {
      Fail("setting a limit", errno);
    }
  }
  const sched_param no_priority = {};
  if (plan.spec->batch && sched_setscheduler(0, SCHED_BATCH, &no_priority) != 0) {
    Fail("scheduling as a batch", errno);
  }
  if (chdir("/") != 0) Fail("/", errno);
  char* const environment[] = {nullptr};
  execve(kBubblewrap, plan.arguments.data(), environment);
  Fail("bubblewrap can't be started (package bubblewrap)", errno);
}

}  // namespace

nlohmann::json SandboxSpecToJson(const SandboxSpec& spec) {
  nlohmann::json json = {{"command", spec.command},
                         {"working_dir", spec.working_dir},
                         {"network", spec.bus ? "loopback with LCM's multicast" : "none"},
                         {"process_1", spec.as_first ? spec.command.front() : "bwrap"},
                         {"begins", spec.held ? "when it is asked for" : "at once"},
                         {"uid", spec.uid},
                         {"uid_inside", spec.inner_uid},
                         {"tasks", spec.tasks},
                         {"scheduling", spec.batch ? "batch" : "other"},
                         {"namespaces", {"user", "pid", "ipc", "uts", "mount", "net", "cgroup"}},
                         {"capabilities", nlohmann::json::array()},
                         {"no_new_privileges", true},
                         {"mounts", nlohmann::json::array()},
                         {"environment", nlohmann::json::object()},
                         {"limits", nlohmann::json::object()}};
  for (const SandboxMount& mount : spec.mounts) {
    json["mounts"].push_back(
        {{"kind", WordsOf(mount.kind).name}, {"source", mount.source}, {"target", mount.target}});
  }
  for (const auto& [name, value] : spec.environment) json["environment"][name] = value;
  for (const SandboxLimit& limit : spec.limits) json["limits"][limit.name] = limit.value;
  return json;
}

absl::StatusOr<std::unique_ptr<Sandbox>> Sandbox::Start(const SandboxSpec& spec,
                                                        const std::vector<SandboxFd>& fds,
                                                        const std::vector<int>& join,
                                                        const Fd& filter) {
  ASSIGN_OR_RETURN(Pipe status, MakeOutputPipe());
  ASSIGN_OR_RETURN(Pipe gate, spec.held ? MakePipe() : Pipe());
  std::optional<BusNetwork> network;
  if (spec.bus) {
    ASSIGN_OR_RETURN(network, BusNetwork::Make());
  }
  std::vector<std::string> arguments = Arguments(spec, filter.valid());
  ChildPlan plan = {ExecVector(arguments), fds, join, &spec,
                    network.has_value() ? network->fd() : -1, getpid()};
  plan.fds.push_back({status.write.get(), kStatusFd});
  if (spec.held) plan.fds.push_back({gate.read.get(), kGateFd});
  if (filter.valid()) {
    lseek(filter.get(), 0, SEEK_SET);
    plan.fds.push_back({filter.get(), kFilterFd});
  }
  const pid_t pid = fork();
  if (pid < 0) {
    return absl::InternalError(absl::StrCat("can't start a process: ", std::strerror(errno)));
  }
  if (pid == 0) BecomeSandbox(plan);
  // From here on the destructor ends the process.
  std::unique_ptr<Sandbox> sandbox(new Sandbox());
  sandbox->pid_ = pid;
  sandbox->network_ = std::move(network);
  sandbox->status_ = std::move(status.read);
  sandbox->gate_ = std::move(gate.write);
  return sandbox;
}

void Sandbox::ReadStatus() {
  char buffer[1024];
  for (ssize_t n; status_.valid() && (n = read(status_.get(), buffer, sizeof(buffer))) > 0;) {
    report_.append(buffer, static_cast<size_t>(n));
  }
  // One JSON object per line: first {"child-pid": N, ...}, then, only if the command was executed,
  // {"exit-code": N}.
  size_t end;
  while ((end = report_.find('\n')) != std::string::npos) {
    const auto json = nlohmann::json::parse(report_.substr(0, end), nullptr, false);
    report_.erase(0, end + 1);
    if (!json.is_object()) continue;
    if (json.contains("child-pid") && json["child-pid"].is_number_integer() && !first_.valid()) {
      first_ = Fd(static_cast<int>(syscall(SYS_pidfd_open, json["child-pid"].get<pid_t>(), 0)));
    }
    if (json.contains("exit-code") && json["exit-code"].is_number_integer()) {
      end_.started = true;
      end_.exit_code = json["exit-code"].get<int>();
    }
  }
}

bool Sandbox::Ended() {
  if (reaped_) return true;
  ReadStatus();
  int status = 0;
  if (waitpid(pid_, &status, WNOHANG) != pid_) return false;
  reaped_ = true;
  end_.wait_status = status;
  ReadStatus();
  return true;
}

bool Sandbox::Wait(absl::Duration timeout) {
  const Deadline deadline(timeout);
  // Looks again and again, as bubblewrap's reports have to be read meanwhile.
  while (!Ended()) {
    if (deadline.over()) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

void Sandbox::KillNow() {
  if (!Ended() && first_.valid()) {
    syscall(SYS_pidfd_send_signal, first_.get(), SIGKILL, nullptr, 0);
  }
}

bool Sandbox::Gone() {
  if (!Ended()) return false;
  pollfd entry = {first_.get(), POLLIN, 0};
  return !first_.valid() || poll(&entry, 1, 0) == 1;
}

bool Sandbox::Kill(absl::Duration timeout) {
  const Deadline deadline(timeout);
  if (!Ended()) {
    // When process 1 of its pid namespace dies, so does everything in it; bubblewrap then exits by
    // itself.
    KillNow();
    if (!first_.valid() || !Wait(absl::Milliseconds(300))) {
      kill(pid_, SIGKILL);
      if (!Wait(deadline.left())) return false;
    }
  }
  if (!first_.valid()) return true;
  pollfd entry = {first_.get(), POLLIN, 0};
  const auto left = absl::ToInt64Milliseconds(deadline.left());
  return poll(&entry, 1, static_cast<int>(left)) == 1;
}

Sandbox::~Sandbox() { Kill(absl::Seconds(5)); }

}  // namespace myograde::server
