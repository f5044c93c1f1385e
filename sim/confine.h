// The simulator's own system call filter, set on itself once everything that
// it reads is read. Whatever a participant's numbers might do to the physics
// engine after that, the process can only compute, talk on descriptors that it
// holds and end.
#pragma once

#include <string>
#include <vector>

#include <absl/status/status.h>

namespace myograde::sim {

// What may become of memory that was written to.
enum class NewCode {
  kNone,      // nothing
  // mprotect can make it executable, but not executable and writable at once: for a renderer, which
  // compiles what it draws with.
  kCompiled,
};

// From here on this process and all its threads may make the system calls of
// `names` only; any other ends the process with SIGSYS, which the runner takes
// for a fault of the grader. Stricter than the names say: mmap and mprotect
// never make memory executable (but see NewCode), tgkill reaches this process alone, setsockopt
// sets a receive timeout and nothing else.
//
// InvalidArgumentError: a name is not a system call, or one that this filter
// exists to keep out (starting programs or processes, opening files, making
// sockets, tracing). InternalError: the kernel refuses the filter.
//
// In sanitizer builds the calls that a sanitizer's report needs are allowed as
// well; opening files for reading is one of them.
absl::Status AllowOnly(const std::vector<std::string>& names, NewCode code = NewCode::kNone);

}  // namespace myograde::sim
