// The policy's process as a child of the bridge.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde::bridge {

// What the policy is started with.
struct PolicyCommand {
  std::vector<std::string> words;        // the program and its arguments; not empty
  std::vector<std::string> environment;  // "NAME=value"; these win over what every policy finds
};

struct Child {
  pid_t pid = -1;
  Fd start_error;  // gives an errno if exec failed, the end of file if it worked
};

// Starts `command` in a session of its own, in the current folder, with stdin
// from /dev/null, stdout and stderr inherited, no other descriptor, and an
// environment that holds MYOGRADE_LCM_URL, MYOGRADE_PROTOCOL, HOME, what of kPassedOn
// (child.cc) the bridge has itself, and the command's own variables.
absl::StatusOr<Child> StartPolicy(const PolicyCommand& command);

}  // namespace myograde::bridge
