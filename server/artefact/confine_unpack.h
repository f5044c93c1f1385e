// Drops the privileges of the process that unpacks an archive, before it reads the first byte.
#pragma once

#include <absl/status/status.h>

namespace myograde::server {

// For a single-threaded process that has opened all it needs. Leaves it `folder` (a descriptor) and
// what is below as its whole file system, no capabilities and no way to gain any, and the few
// system calls that unpacking makes. Any other call kills the process with SIGSYS: it can't start
// programs or processes, open sockets, send signals, or change any mode, owner or name except with
// the calls of unpacking. Non-root users enter the folder through a user namespace.
// UnavailableError: this host does not permit it.
absl::Status ConfineUnpacking(int folder);

}  // namespace myograde::server
