// What the UDP and TCP sockets of a network hold of the kernel's memory, as
// sock_diag(7) tells it.
#pragma once

#include <cstdint>

#include "protocol/base/fd.h"

namespace myograde::server {

// A descriptor to ask through about the calling thread's network, also from
// another one; invalid where the kernel has none.
Fd OpenSocketDiagnosis();

// Bytes by the kernel's own count, in which what several sockets share counts for
// each; 0 where it does not tell. Milliseconds on a host with large tables.
int64_t SocketBytes(const Fd& diagnosis);

}  // namespace myograde::server
