#include "server/base/child_process.h"

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

#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

constexpr int kMostReads = 64;
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
      wait_status_(other.wait_status_) {}

ChildProcess::~ChildProcess() {
  if (pid_ < 0 || wait_status_.has_value()) return;
  ::kill(-pid_, SIGKILL);
  while (::waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

bool ChildProcess::Look() {
  if (!wait_status_.has_value()) {
    int status = 0;
    if (::waitpid(pid_, &status, WNOHANG) == pid_) wait_status_ = status;
  }
  char buffer[4096];
  // As often as empties a full pipe, so that a flood keeps nobody from a deadline.
  for (int reads = 0; err_.valid() && reads < kMostReads; ++reads) {
    const ssize_t size = ::read(err_.get(), buffer, sizeof(buffer));
    if (size < 0 && errno == EINTR) continue;
    if (size < 0 && errno == EAGAIN) break;
    if (size <= 0) err_.reset();
    if (size > 0) said_.Append({buffer, static_cast<size_t>(size)});
  }
  return wait_status_.has_value();
}

void ChildProcess::Signal(int signal) const {
  if (!wait_status_.has_value()) ::kill(pid_, signal);
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
