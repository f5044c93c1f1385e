#include "server/cli/offline/captured_run.h"

#include <poll.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include <absl/strings/str_cat.h>
#include <absl/strings/strip.h>

#include "protocol/base/clock.h"
#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/spawn.h"
#include "server/cli/offline/stop_signal.h"

namespace myograde::server {
namespace {

constexpr int kNiceOfRuns = 10;
constexpr int kPollStep_ms = 200;
constexpr size_t kReadStep = 1 << 16;
constexpr off_t kMostError = 1 << 14;

// Bytes that a program reads or writes as a file, so that no pipe can block either side.
absl::StatusOr<Fd> MemoryFile(std::string_view content) {
  Fd file(::memfd_create("myograde", MFD_CLOEXEC));
  if (!file.valid()) {
    return absl::InternalError(absl::StrCat("no file in memory: ", std::strerror(errno)));
  }
  if (absl::Status status = WriteAll(file.get(), content); !status.ok()) {
    return absl::InternalError(status.message());
  }
  ::lseek(file.get(), 0, SEEK_SET);
  return file;
}

// A child process with its group, which is dead and reaped when this ends.
class CapturedChild {
 public:
  explicit CapturedChild(pid_t pid) : pid_(pid) {}
  CapturedChild(const CapturedChild&) = delete;
  CapturedChild& operator=(const CapturedChild&) = delete;
  ~CapturedChild() {
    if (pid_ <= 0) return;
    ::kill(-pid_, SIGKILL);
    Reap();
  }

  // Waits for its end, which is near: it has closed its output.
  int Reap() {
    int status = 0;
    while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
    }
    pid_ = -1;
    return status;
  }

  bool EndsBefore(absl::Duration deadline) const {
    return EndsWithin(pid_, std::max(absl::ZeroDuration(), deadline - SystemClock().Monotonic()));
  }

 private:
  pid_t pid_;
};

absl::Status Drain(int fd, absl::Duration deadline, size_t most_bytes, std::string& out) {
  char bytes[kReadStep];
  for (;;) {
    if (StopRequested()) return absl::CancelledError("interrupted");
    if (SystemClock().Monotonic() >= deadline) return absl::DeadlineExceededError("too slow");
    pollfd ready = {fd, POLLIN, 0};
    if (::poll(&ready, 1, kPollStep_ms) <= 0) continue;
    const ssize_t n = ::read(fd, bytes, sizeof(bytes));
    if (n == 0) return absl::OkStatus();
    if (n < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (n < 0) return absl::InternalError(std::strerror(errno));
    if (out.size() + static_cast<size_t>(n) > most_bytes) {
      return absl::ResourceExhaustedError("it printed too much");
    }
    out.append(bytes, static_cast<size_t>(n));
  }
}

std::string LastLineOf(const Fd& file) {
  const off_t size = ::lseek(file.get(), 0, SEEK_END);
  std::string text(static_cast<size_t>(std::clamp<off_t>(size, 0, kMostError)), '\0');
  const ssize_t n =
      ::pread(file.get(), text.data(), text.size(), size - static_cast<off_t>(text.size()));
  text.resize(static_cast<size_t>(std::max<ssize_t>(n, 0)));
  text.resize(text.find_last_not_of(" \n") + 1);
  return text.substr(text.rfind('\n') + 1);
}

std::string EndText(int status) {
  if (WIFSIGNALED(status)) return absl::StrCat("was killed by signal ", WTERMSIG(status));
  return absl::StrCat("exited with status ", WEXITSTATUS(status));
}

}  // namespace

absl::StatusOr<CapturedRun> RunCaptured(std::vector<std::string> words, std::string_view in,
                                        absl::Duration timeout, size_t most_bytes) {
  const absl::Duration deadline = SystemClock().Monotonic() + timeout;
  const absl::StatusOr<Fd> input = MemoryFile(in);
  if (!input.ok()) return input.status();
  const absl::StatusOr<Fd> errors = MemoryFile("");
  if (!errors.ok()) return errors.status();
  absl::StatusOr<Pipe> output = MakeOutputPipe();
  if (!output.ok()) return output.status();
  const std::string program = words.at(0);
  const absl::StatusOr<pid_t> pid = Spawn({.program = program,
                                           .words = std::move(words),
                                           .in = input->get(),
                                           .out = output->write.get(),
                                           .err = errors->get(),
                                           .nice = kNiceOfRuns});
  output->write.reset();
  if (!pid.ok()) return absl::InternalError(pid.status().message());
  CapturedChild child(*pid);
  CapturedRun run;
  if (absl::Status status = Drain(output->read.get(), deadline, most_bytes, run.out);
      !status.ok()) {
    return status;
  }
  if (!child.EndsBefore(deadline)) return absl::DeadlineExceededError("too slow");
  const int status = child.Reap();
  run.good = WIFEXITED(status) && WEXITSTATUS(status) == 0;
  run.ended = EndText(status);
  run.error = LastLineOf(*errors);
  return run;
}

}  // namespace myograde::server
