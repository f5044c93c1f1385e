// The policy's process as a child of the bridge.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde::bridge {

// How to start the policy.
struct PolicyCommand {
  std::vector<std::string> words;        // the program and its arguments; not empty
  std::vector<std::string> environment;  // "NAME=value"; these override the environment that every
                                         // policy gets
  std::string working_dir = {};          // "": where the bridge is
};

struct Child {
  pid_t pid = -1;
  Fd start_error;  // yields an errno if exec failed, end of file if it succeeded
};

// Starts `command` in its own session, in its working folder, with stdin from /dev/null, stdout and
// stderr inherited, no other descriptor, and an environment of MYOGRADE_LCM_URL, MYOGRADE_PROTOCOL,
// HOME, those of kPassedOn (child.cc) that the bridge has itself, and the command's own variables.
absl::StatusOr<Child> StartPolicy(const PolicyCommand& command);

}  // namespace myograde::bridge
