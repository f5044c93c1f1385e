// Starting programs, waiting for them, and the pieces that those share who start theirs in a way
// of their own (sandboxes, the bridge).
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

// A pipe whose ends close on exec and lie above the standard streams, so that none is overwritten
// before it was moved there. InternalError if there is none.
absl::StatusOr<Pipe> MakePipe();

// The same; its reader never waits.
absl::StatusOr<Pipe> MakeOutputPipe();

// What exec(3) takes: pointers to `words`, which must outlive them unchanged, and a null.
std::vector<char*> ExecVector(std::vector<std::string>& words);

struct SpawnOrder {
  std::string program;             // a path
  std::vector<std::string> words;  // its arguments, the name that it sees of itself first
  // Descriptors above 2 that become its standard streams.
  int in = -1;   // -1: /dev/null
  int out = -1;  // -1: those of this process
  int err = -1;
  int nice = 0;  // as of setpriority(2); 0: that of this process
};

// Starts a program in a process group of its own, with this process' environment, no other
// descriptor, no signal blocked, and SIGINT, SIGTERM, SIGPIPE, SIGHUP and SIGCHLD as at the
// beginning. InternalError if it can't be executed. Spawned, not forked: a copy of a large process'
// page tables would hold that up, the longer the more it has in memory.
absl::StatusOr<pid_t> Spawn(SpawnOrder order);

// Waits until `child` of this process has ended, and leaves it to be reaped. False: it still runs
// after `timeout`.
bool EndsWithin(pid_t child, absl::Duration timeout);

}  // namespace myograde
