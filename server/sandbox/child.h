// Runs trials in a child process with a deadline.
#pragma once

#include <functional>
#include <string>

#include <absl/time/time.h>

namespace myograde::server {

struct ChildEnd {
  bool in_time = false;  // it ended by itself before the deadline
  int exit_code = -1;    // 128 + signal if killed by one; -1: not started, or late
  std::string output;    // the first 1 MiB of stdout and stderr combined
};

// Runs `work` in a fork of this process, with stdin at end of file; its result is the exit code.
// Kills the child's process group at `timeout`. REQUIRES: a single thread.
ChildEnd RunInChild(const std::function<int()>& work, absl::Duration timeout);

// The last `lines` non-empty lines, joined by "; ", without control characters.
std::string LastWords(const std::string& output, int lines = 1);

}  // namespace myograde::server
