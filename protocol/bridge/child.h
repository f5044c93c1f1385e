// The policy's process as a child of the bridge.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde::bridge {

struct Child {
  pid_t pid = -1;
  Fd start_error;  // gives an errno if exec failed, the end of file if it worked
};

// Starts `command` in a session of its own, in the current folder, with stdin
// from /dev/null, stdout and stderr inherited, no other descriptor, and an
// environment that holds MYOGRADE_LCM_URL, MYOGRADE_PROTOCOL, HOME and, from
// the bridge's own, PATH, PYTHONPATH, PYTHONDONTWRITEBYTECODE and OMP_NUM_THREADS. REQUIRES: command is not empty.
absl::StatusOr<Child> StartPolicy(const std::vector<std::string>& command);

}  // namespace myograde::bridge
