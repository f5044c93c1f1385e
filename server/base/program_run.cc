#include "server/base/program_run.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/file.h"
#include "protocol/base/spawn.h"
#include "server/base/output_tail.h"
#include "server/base/paths.h"

namespace myograde::server {
namespace {

constexpr int kPollMilliseconds = 100;
constexpr int64_t kErrorBytes = 4096;

// Kills the program with its group, and reaps it, unless it has been.
class ProgramProcess {
 public:
  explicit ProgramProcess(pid_t pid) : pid_(pid) {}
  ~ProgramProcess() {
    if (pid_ <= 0) return;
    kill(-pid_, SIGKILL);
    while (waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) continue;
  }
  ProgramProcess(const ProgramProcess&) = delete;
  ProgramProcess& operator=(const ProgramProcess&) = delete;

  // True once it has ended.
  bool Reap(int& status) {
    if (pid_ > 0 && waitpid(pid_, &status, WNOHANG) != pid_) return false;
    pid_ = -1;
    return true;
  }

 private:
  pid_t pid_;
};

absl::StatusOr<Fd> InputFile(const std::string& text) {
  Fd file(memfd_create("myograde-input", MFD_CLOEXEC));
  if (!file.valid() || !WriteAll(file.get(), text).ok() || lseek(file.get(), 0, SEEK_SET) != 0) {
    return absl::InternalError(absl::StrCat("can't make a memory file: ", std::strerror(errno)));
  }
  // Above the standard streams, so that none is overwritten before it has been moved there.
  Fd high(fcntl(file.get(), F_DUPFD_CLOEXEC, 3));
  return high;
}

// Reads what is there; false at the end of the stream.
bool Drain(Fd& fd, const std::function<void(std::string_view)>& take) {
  char buffer[64 << 10];
  const ssize_t n = read(fd.get(), buffer, sizeof(buffer));
  if (n > 0) take(std::string_view(buffer, static_cast<size_t>(n)));
  if (n == 0 || (n < 0 && errno != EINTR && errno != EAGAIN)) fd.reset();
  return fd.valid();
}

absl::StatusOr<std::string> ProgramPath(const std::string& program) {
  std::string path = program;
  if (program.find('/') == std::string::npos) {
    const absl::StatusOr<std::string> bin_dir = BinDir();
    if (!bin_dir.ok()) return bin_dir.status();
    path = absl::StrCat(*bin_dir, "/", program);
  }
  if (access(path.c_str(), X_OK) == 0) return path;
  return absl::InternalError(absl::StrCat("no program ", path, " (", std::strerror(errno), ")"));
}

}  // namespace

std::string ProgramEnd::HowItEnded() const {
  return exit_status > 128 ? absl::StrCat("was killed by signal ", exit_status - 128)
                           : absl::StrCat("exited with status ", exit_status);
}

std::string ProgramEnd::LastError() const {
  const std::string text = errors.substr(0, errors.find_last_not_of(" \n") + 1);
  return text.substr(text.rfind('\n') + 1);
}

absl::StatusOr<ProgramEnd> RunProgram(const ProgramOrder& order,
                                      const std::function<bool()>& stopped) {
  const absl::StatusOr<std::string> found = ProgramPath(order.program);
  if (!found.ok()) return found.status();
  const std::string& path = *found;
  absl::StatusOr<Fd> in = InputFile(order.input);
  if (!in.ok()) return in.status();
  absl::StatusOr<Pipe> out = MakeOutputPipe();
  if (!out.ok()) return out.status();
  absl::StatusOr<Pipe> err = MakeOutputPipe();
  if (!err.ok()) return err.status();
  std::vector<std::string> words = {path};
  words.insert(words.end(), order.words.begin(), order.words.end());
  const absl::StatusOr<pid_t> pid =
      Spawn({path, words, in->get(), out->write.get(), err->write.get(), order.nice});
  if (!pid.ok()) return pid.status();
  ProgramProcess process(*pid);
  out->write.reset();
  err->write.reset();
  ProgramEnd end;
  OutputTail errors(kErrorBytes);
  const Deadline deadline(order.deadline);
  int status = 0;
  for (bool open = true; open || !process.Reap(status);) {
    pollfd entries[] = {{out->read.get(), POLLIN, 0}, {err->read.get(), POLLIN, 0}};
    poll(entries, std::size(entries), kPollMilliseconds);
    if (entries[0].revents != 0) {
      Drain(out->read, [&](std::string_view bytes) { end.output += bytes; });
    }
    if (entries[1].revents != 0) {
      Drain(err->read, [&](std::string_view bytes) { errors.Append(bytes); });
    }
    open = out->read.valid() || err->read.valid();
    if (end.output.size() > order.most_output) {
      return absl::ResourceExhaustedError(
          absl::StrCat(order.program, " printed more than ", order.most_output, " bytes"));
    }
    if (stopped()) return absl::CancelledError(absl::StrCat(order.program, " was stopped"));
    if (deadline.over()) {
      return absl::DeadlineExceededError(absl::StrCat(
          order.program, " was not done after ", absl::FormatDuration(order.deadline)));
    }
  }
  end.exit_status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  end.errors = errors.tail();
  return end;
}

}  // namespace myograde::server
