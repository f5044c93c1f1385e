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
  std::string words;
  size_t end = output.size();
  while (lines > 0 && end > 0) {
    const size_t newline = output.rfind('\n', end - 1);
    const size_t begin = newline == std::string::npos ? 0 : newline + 1;
    std::string line = output.substr(begin, end - begin);
    line.erase(line.find_last_not_of(" \r\n") + 1);
    end = newline == std::string::npos ? 0 : newline;
    if (line.empty()) continue;
    words = words.empty() ? line : line + "; " + words;
    --lines;
  }
  for (char& c : words) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  }
  return words;
}

}  // namespace myograde::server
