// A program that is started, and whose standard error is kept.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>
#include <string_view>

#include <absl/status/statusor.h>

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

}  // namespace myograde::server
