#include "server/sandbox/child.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>

#include <absl/strings/ascii.h>
#include <absl/strings/str_join.h>
#include <absl/strings/str_split.h>

#include "protocol/base/clock.h"
#include "protocol/base/spawn.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxOutputBytes = 1 << 20;
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

// Reads what is available; false at end of file.
bool Drain(int fd, std::string& output) {
  char buffer[16 << 10];
  while (true) {
    const ssize_t n = read(fd, buffer, sizeof(buffer));
    if (n < 0) return errno == EAGAIN || errno == EINTR;
    if (n == 0) return false;
    const size_t room = kMaxOutputBytes - output.size();
    output.append(buffer, std::min(room, static_cast<size_t>(n)));
  }
}

}  // namespace

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
  bool open = true;
  while (!end.in_time && !deadline.over()) {
    pollfd entry = {open ? output->read.get() : -1, POLLIN, 0};
    poll(&entry, 1, kPollMs);
    end.in_time = waitpid(child, &status, WNOHANG) == child;
    if (open) open = Drain(output->read.get(), end.output);
  }
  kill(-child, SIGKILL);  // it, or what it left behind
  if (end.in_time) {
    end.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  } else {
    waitpid(child, &status, 0);
  }
  return end;
}

std::string LastWords(const std::string& output, int lines) {
  std::vector<std::string> last;
  for (absl::string_view line : absl::StrSplit(output, '\n')) {
    line = absl::StripTrailingAsciiWhitespace(line);
    if (!line.empty()) last.emplace_back(line);
  }
  last.erase(last.begin(), last.end() - std::min<std::ptrdiff_t>(lines, std::ssize(last)));
  std::string words = absl::StrJoin(last, "; ");
  std::replace_if(words.begin(), words.end(), absl::ascii_iscntrl, '?');
  return words;
}

}  // namespace myograde::server
