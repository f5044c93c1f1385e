// Starts programs and waits for them, and helpers for code that starts its own differently
// (sandboxes, the bridge).
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"

namespace myograde {

struct Pipe {
  Fd read;
  Fd write;
};

// A close-on-exec pipe whose descriptors are above the standard streams, so that none is
// overwritten before it has been moved there. InternalError if it can't be created.
absl::StatusOr<Pipe> MakePipe();

// The same, with a non-blocking read end.
absl::StatusOr<Pipe> MakeOutputPipe();

// The argument vector for exec(3): pointers to `words`, which must outlive it unchanged, and a
// null.
std::vector<char*> ExecVector(std::vector<std::string>& words);

struct SpawnOrder {
  std::string program;             // a path
  std::vector<std::string> words;  // its arguments, beginning with its own name
  // Descriptors above 2 that become its standard streams.
  int in = -1;   // -1: /dev/null
  int out = -1;  // -1: inherited from this process
  int err = -1;
  int nice = 0;  // as of setpriority(2); 0: inherited from this process
  std::vector<std::string> environment = {};  // "NAME=VALUE" each; none: that of this process
};

// Starts a program in its own process group, with no other descriptor, no signal blocked, and default handling of SIGINT, SIGTERM, SIGPIPE, SIGHUP and SIGCHLD.
// InternalError if it can't be executed. Spawned, not forked: copying a large process' page tables
// would stall it, the longer the more memory it uses.
absl::StatusOr<pid_t> Spawn(SpawnOrder order);

// Waits until `child` of this process has exited, without reaping it. False: it is still running
// after `timeout`.
bool EndsWithin(pid_t child, absl::Duration timeout);

}  // namespace myograde
