// Programs that are started: the end of what one says, one whose standard error is kept, and one
// that runs to its end, with text in, bytes out and a deadline. And how a program is asked to end.
#pragma once

#include <signal.h>
#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "protocol/base/spawn.h"

namespace myograde::server {

// Counts a stream's output and keeps its end. Memory stays bounded for any amount of output.
class OutputTail {
 public:
  static constexpr size_t kTailBytes = 4096;

  // `limit`: output beyond this many bytes counts as truncated.
  explicit OutputTail(int64_t limit) : limit_(limit) {}

  void Append(std::string_view bytes);

  // The last kTailBytes of the output at most, printable. `since`: a value of total(); omits output
  // before it.
  std::string tail(int64_t since = 0) const;
  bool truncated() const { return total_ > limit_; }
  int64_t total() const { return total_; }

 private:
  int64_t limit_;
  int64_t total_ = 0;
  std::string kept_;
};

// Appends what a non-blocking descriptor has, in at most `reads` reads of 16 KiB, and closes it at
// its end.
void DrainInto(Fd& fd, int reads, OutputTail& tail);

// Appends what such a descriptor has to `out`, 64 KiB at most, and closes it at its end.
void Drain(Fd& fd, std::string& out);

// Has a process group of its own. Killed when this object goes.
class ChildProcess {
 public:
  // As Spawn, which sets `order.err`: the end of what the program says there is kept.
  static absl::StatusOr<ChildProcess> Start(SpawnOrder order);
  ChildProcess(ChildProcess&& other) noexcept;
  ChildProcess& operator=(ChildProcess&&) = delete;
  ~ChildProcess();

  // To poll for its standard error.
  int err_fd() const { return err_.get(); }

  // Takes note of what it said and whether it ended, without waiting. True once it has ended.
  bool Look();

  // Sends it a signal, unless it has ended.
  void Signal(int signal) const {
    if (!wait_status_.has_value()) ::kill(pid_, signal);
  }
  // Kills it and what it started in its process group, unless it has ended.
  void KillNow() const {
    if (pid_ > 0 && !wait_status_.has_value()) ::kill(-pid_, SIGKILL);
  }

  pid_t pid() const { return pid_; }

  // As of waitpid(2). REQUIRES: it has ended.
  int wait_status() const { return *wait_status_; }
  // Of it and all that it waited for, once it has ended; 0 before.
  double cpu_s() const { return cpu_s_; }
  bool succeeded() const { return *wait_status_ == 0; }
  // The end of what it said, as valid UTF-8.
  std::string said() const { return said_.tail(); }
  // How it ended, in words; with the last line that it said if there is one.
  std::string Failure() const;

 private:
  ChildProcess(std::string name, pid_t pid, Fd err);

  std::string name_;
  pid_t pid_;
  Fd err_;
  OutputTail said_;
  std::optional<int> wait_status_;
  double cpu_s_ = 0;
};

// The last line of `text` that is not empty, without what ends it; "" if there is none.
std::string LastLineOf(std::string_view text);

// The program `name` in the folders of PATH. NotFoundError if it is in none.
absl::StatusOr<std::string> FindProgram(const std::string& name);

struct ProgramOrder {
  std::string program;                  // its path, or the name of one beside this program
  std::vector<std::string> words = {};  // its arguments
  std::string input = {};               // for its standard input
  size_t most_output = 0;               // bytes of its standard output that are taken
  absl::Duration deadline = absl::Minutes(10);
  int nice = 19;
  std::vector<std::string> environment = {};  // as of SpawnOrder
};

struct ProgramEnd {
  int exit_status = 0;  // 128 + N: signal N ended it
  std::string output;
  std::string errors;  // the end of its standard error, as valid UTF-8

  std::string HowItEnded() const;  // "exited with status 2", "was killed by signal 11"
  std::string LastError() const { return LastLineOf(errors); }
};

// Of a program that failed: the last line of its errors, or how it ended, or why it was not run.
std::string WhyItFailed(const absl::StatusOr<ProgramEnd>& end);

// CancelledError as soon as `stopped` (asked ten times a second), DeadlineExceededError,
// ResourceExhaustedError if it prints more than it may: it and what it started are dead on return.
// InternalError: it can't be started.
absl::StatusOr<ProgramEnd> RunProgram(
    const ProgramOrder& order, const std::function<bool()>& stopped = [] { return false; });

// From now on SIGTERM, SIGINT and SIGHUP make this descriptor (signalfd(2)) readable, in this
// thread and those that it starts, and SIGPIPE is ignored.
Fd StopSignals();

// Moves this process, which has a single thread, into a new user namespace, in which it may do
// whatever root may do to what belongs to it, and is the same user otherwise. False: errno says
// why.
bool EnterUserNamespace();

}  // namespace myograde::server
