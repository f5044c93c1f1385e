#include "server/base/child_process.h"

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>
#include <absl/strings/strip.h>
#include <absl/time/time.h>

#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

constexpr int kMostReads = 16;
constexpr absl::Duration kBurial = absl::Seconds(10);
constexpr char kUsualPath[] = "/usr/local/bin:/usr/bin:/bin";

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

void ChildProcess::Signal(int signal) const {
  if (!wait_status_.has_value()) ::kill(pid_, signal);
}

void ChildProcess::KillNow() const {
  if (pid_ > 0 && !wait_status_.has_value()) ::kill(-pid_, SIGKILL);
}

bool ChildProcess::succeeded() const {
  return WIFEXITED(*wait_status_) && WEXITSTATUS(*wait_status_) == 0;
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
  for (const auto& folder : absl::StrSplit(path == nullptr ? kUsualPath : path, ':')) {
    if (folder.empty()) continue;
    const std::string file = absl::StrCat(folder, "/", name);
    if (::access(file.c_str(), X_OK) == 0) return file;
  }
  return absl::NotFoundError(name + " is not installed");
}

}  // namespace myograde::server
