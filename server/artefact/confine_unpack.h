// What the process that unpacks an archive gives up before it reads the first
// byte of it.
#pragma once

#include <absl/status/status.h>

namespace myograde::server {

// For a process with one thread that has opened all it needs: leaves it `folder`
// (a descriptor) and what is below as its whole file system, no capabilities and no
// way to gain any, and the few system calls that unpacking makes. Any other call
// ends the process with SIGSYS: it does not start programs or processes, has no
// sockets, signals nobody and changes no mode, owner or name but with the calls of
// unpacking. Who is not root gets the folder through a user namespace.
// UnavailableError: this host does not let it.
absl::Status ConfineUnpacking(int folder);

}  // namespace myograde::server
