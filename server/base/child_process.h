// Programs that are started: one whose standard error is kept, and one that runs to its end, with
// text in, bytes out and a deadline.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "protocol/base/spawn.h"
#include "server/base/output_tail.h"

namespace myograde::server {

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
  void Signal(int signal) const;
  // Kills it and what it started in its process group, unless it has ended.
  void KillNow() const;

  pid_t pid() const { return pid_; }

  // As of waitpid(2). REQUIRES: it has ended.
  int wait_status() const { return *wait_status_; }
  // Of it and all that it waited for, once it has ended; 0 before.
  double cpu_s() const { return cpu_s_; }
  bool succeeded() const;
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
  std::string LastError() const;   // the last line of `errors`; "" if there is none
};

// Of a program that failed: the last line of its errors, or how it ended, or why it was not run.
std::string WhyItFailed(const absl::StatusOr<ProgramEnd>& end);

// CancelledError as soon as `stopped` (asked ten times a second), DeadlineExceededError,
// ResourceExhaustedError if it prints more than it may: it and what it started are dead on return.
// InternalError: it can't be started.
absl::StatusOr<ProgramEnd> RunProgram(
    const ProgramOrder& order, const std::function<bool()>& stopped = [] { return false; });

}  // namespace myograde::server
