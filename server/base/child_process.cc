#include "server/base/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/signalfd.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>
#include <absl/strings/strip.h>

#include "protocol/base/clock.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/base/paths.h"
#include "server/base/plain_text.h"

namespace myograde::server {

void OutputTail::Append(std::string_view bytes) {
  total_ += static_cast<int64_t>(bytes.size());
  if (bytes.size() > kTailBytes) bytes.remove_prefix(bytes.size() - kTailBytes);
  kept_ += bytes;
  if (kept_.size() > kTailBytes) kept_.erase(0, kept_.size() - kTailBytes);
}

std::string OutputTail::tail(int64_t since) const {
  const auto wanted = static_cast<size_t>(std::max<int64_t>(total_ - since, 0));
  std::string_view kept = kept_;
  if (kept.size() > wanted) kept.remove_prefix(kept.size() - wanted);
  // Replacements may have made it longer.
  return std::string(LastOf(PrintableUtf8(kept), kTailBytes));
}

void DrainInto(Fd& fd, int reads, OutputTail& tail) {
  char buffer[16 << 10];
  for (int i = 0; fd.valid() && i < reads; ++i) {
    const ssize_t n = ::read(fd.get(), buffer, sizeof(buffer));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno == EAGAIN) return;
    if (n <= 0) return fd.reset();
    tail.Append({buffer, static_cast<size_t>(n)});
  }
}

void Drain(Fd& fd, std::string& out) {
  char buffer[64 << 10];
  const ssize_t n = read(fd.get(), buffer, sizeof(buffer));
  if (n > 0) out.append(buffer, static_cast<size_t>(n));
  if (n == 0 || (n < 0 && errno != EINTR && errno != EAGAIN)) fd.reset();
}

namespace {

constexpr int kMostReads = 16;
constexpr absl::Duration kBurial = absl::Seconds(10);
constexpr char kDefaultPath[] = "/usr/local/bin:/usr/bin:/bin";
constexpr int kPollMilliseconds = 100;

absl::StatusOr<std::string> ProgramPath(const std::string& program) {
  std::string path = program;
  if (program.find('/') == std::string::npos) {
    ASSIGN_OR_RETURN(const std::string bin_dir, BinDir());
    path = absl::StrCat(bin_dir, "/", program);
  }
  if (access(path.c_str(), X_OK) == 0) return path;
  return absl::InternalError(absl::StrCat("no program ", path, " (", std::strerror(errno), ")"));
}

}  // namespace

std::string LastLineOf(std::string_view text) {
  text = text.substr(0, text.find_last_not_of(" \n") + 1);
  return std::string(text.substr(text.rfind('\n') + 1));
}

absl::StatusOr<ChildProcess> ChildProcess::Start(SpawnOrder order) {
  ASSIGN_OR_RETURN(Pipe err, MakeOutputPipe());
  order.err = err.write.get();
  const std::string name = std::filesystem::path(order.program).filename();
  ASSIGN_OR_RETURN(const pid_t pid, Spawn(std::move(order)));
  return ChildProcess(name, pid, std::move(err.read));
}

ChildProcess::ChildProcess(std::string name, pid_t pid, Fd err)
    : name_(std::move(name)), pid_(pid), err_(std::move(err)), said_(INT64_MAX) {}

ChildProcess::ChildProcess(ChildProcess&& other) noexcept
    : name_(std::move(other.name_)),
      pid_(std::exchange(other.pid_, -1)),
      err_(std::move(other.err_)),
      said_(std::move(other.said_)),
      wait_status_(other.wait_status_),
      cpu_s_(other.cpu_s_) {}

ChildProcess::~ChildProcess() {
  if (pid_ < 0 || wait_status_.has_value()) return;
  KillNow();
  // One that is stuck in the kernel is left to whoever ends this process.
  if (EndsWithin(pid_, kBurial)) ::waitpid(pid_, nullptr, 0);
}

bool ChildProcess::Look() {
  if (!wait_status_.has_value()) {
    int status = 0;
    rusage used = {};
    if (::wait4(pid_, &status, WNOHANG, &used) == pid_) {
      wait_status_ = status;
      cpu_s_ = absl::ToDoubleSeconds(absl::DurationFromTimeval(used.ru_utime) +
                                     absl::DurationFromTimeval(used.ru_stime));
    }
  }
  // As often as empties a full pipe, so that a flood keeps nobody from a deadline.
  DrainInto(err_, kMostReads, said_);
  return wait_status_.has_value();
}

std::string ChildProcess::Failure() const {
  const std::string said = LastLineOf(said_.tail());
  if (WIFSIGNALED(*wait_status_)) {
    return absl::StrCat(name_, " was ended by ", ::strsignal(WTERMSIG(*wait_status_)),
                        said.empty() ? "" : ": ", said);
  }
  const std::string sentence(absl::StripPrefix(said, name_ + ": "));
  if (!sentence.empty()) return sentence;
  return absl::StrCat(name_, " ended with status ", WEXITSTATUS(*wait_status_));
}

absl::StatusOr<std::string> FindProgram(const std::string& name) {
  const char* path = std::getenv("PATH");
  for (const auto& folder : absl::StrSplit(path == nullptr ? kDefaultPath : path, ':')) {
    if (folder.empty()) continue;
    const std::string file = absl::StrCat(folder, "/", name);
    if (::access(file.c_str(), X_OK) == 0) return file;
  }
  return absl::NotFoundError(name + " is not installed");
}

std::string ProgramEnd::HowItEnded() const {
  return exit_status > 128 ? absl::StrCat("was killed by signal ", exit_status - 128)
                           : absl::StrCat("exited with status ", exit_status);
}

std::string WhyItFailed(const absl::StatusOr<ProgramEnd>& end) {
  if (!end.ok()) return std::string(end.status().message());
  const std::string last = end->LastError();
  return last.empty() ? end->HowItEnded() : last;
}

absl::StatusOr<ProgramEnd> RunProgram(const ProgramOrder& order,
                                      const std::function<bool()>& stopped) {
  ASSIGN_OR_RETURN(const std::string path, ProgramPath(order.program));
  ASSIGN_OR_RETURN(Fd in, MakeMemoryFile("myograde-input", order.input));
  ASSIGN_OR_RETURN(Pipe out, MakeOutputPipe());
  std::vector<std::string> words = {path};
  words.insert(words.end(), order.words.begin(), order.words.end());
  ASSIGN_OR_RETURN(ChildProcess child, ChildProcess::Start({.program = path,
                                                            .words = words,
                                                            .in = in.get(),
                                                            .out = out.write.get(),
                                                            .nice = order.nice,
                                                            .environment = order.environment}));
  out.write.reset();
  ProgramEnd end;
  const Deadline deadline(order.deadline);
  while (!child.Look() || out.read.valid() || child.err_fd() >= 0) {
    pollfd entries[] = {{out.read.get(), POLLIN, 0}, {child.err_fd(), POLLIN, 0}};
    poll(entries, std::size(entries), kPollMilliseconds);
    if (entries[0].revents != 0) Drain(out.read, end.output);
    if (end.output.size() > order.most_output) {
      return absl::ResourceExhaustedError(
          absl::StrCat(order.program, " printed more than ", order.most_output, " bytes"));
    }
    if (stopped()) return absl::CancelledError(absl::StrCat(order.program, " was stopped"));
    if (deadline.over()) {
      return absl::DeadlineExceededError(absl::StrCat(order.program, " was not done after ",
                                                      absl::FormatDuration(order.deadline)));
    }
  }
  const int status = child.wait_status();
  end.exit_status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  end.errors = child.said();
  return end;
}

bool EnterUserNamespace() {
  const uid_t uid = ::geteuid();
  const gid_t gid = ::getegid();
  if (::unshare(CLONE_NEWUSER) != 0) return false;
  for (const auto& [path, text] :
       {std::pair("/proc/self/setgroups", std::string("deny")),
        std::pair("/proc/self/gid_map", absl::StrCat(gid, " ", gid, " 1")),
        std::pair("/proc/self/uid_map", absl::StrCat(uid, " ", uid, " 1"))}) {
    const Fd file(::open(path, O_WRONLY | O_CLOEXEC));
    if (::write(file.get(), text.data(), text.size()) != std::ssize(text)) return false;
  }
  return true;
}

Fd StopSignals() {
  sigset_t stop;
  sigemptyset(&stop);
  for (int signal : {SIGTERM, SIGINT, SIGHUP}) sigaddset(&stop, signal);
  sigprocmask(SIG_BLOCK, &stop, nullptr);
  ::signal(SIGPIPE, SIG_IGN);
  return Fd(signalfd(-1, &stop, SFD_CLOEXEC | SFD_NONBLOCK));
}

}  // namespace myograde::server
