// Trying things out in a child process that can't outlive its deadline.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <absl/time/time.h>

namespace myograde::server {

struct ChildEnd {
  bool in_time = false;  // it ended by itself before the deadline
  int exit_code = -1;    // 128 + signal if one ended it; -1: it could not be started or was late
  std::string output;    // the first 1 MiB of stdout and stderr together
};

// Runs `work` in a fork of this process, with stdin at its end; its value is
// the exit code. At `timeout` the child's process group is killed. REQUIRES: a
// single thread.
ChildEnd RunInChild(const std::function<int()>& work, absl::Duration timeout);

// Runs a program by its absolute path, arguments[0], with this environment of
// "NAME=value" and nothing else. Exit code 127: it can't be executed, and the
// output says why.
ChildEnd RunProgram(std::vector<std::string> arguments, std::vector<std::string> environment,
                    absl::Duration timeout);

// The last `lines` lines that are not empty, joined by "; ", without control
// characters.
std::string LastWords(const std::string& output, int lines = 1);

}  // namespace myograde::server
