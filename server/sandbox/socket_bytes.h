// Kernel memory held by a network's UDP and TCP sockets, from sock_diag(7).
#pragma once

#include <cstdint>

#include "protocol/base/fd.h"

namespace myograde::server {

// A descriptor for querying the calling thread's network, usable from other networks too; invalid
// if the kernel lacks sock_diag.
Fd OpenSocketDiagnosis();

// Bytes by the kernel's own count, in which memory shared by several sockets counts for each; 0 if
// unknown. Takes milliseconds on a host with large tables.
int64_t SocketBytes(const Fd& diagnosis);

}  // namespace myograde::server
