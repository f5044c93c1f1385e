// A sandbox' system call filter, as a program for bubblewrap's --seccomp.
#pragma once

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "server/sandbox/sandbox_config.h"

namespace myograde::server {

// A memory file with the BPF program, positioned at its start. Allows what the config does not
// deny. Whatever the config says, it denies new namespaces through clone, terminal injection, ways
// to learn of other users of a shared file (leases, locks, hints in its inode, directory
// notification), foreign execution domains, core scheduling cookies, sockets other than stream,
// datagram and seqpacket sockets over TCP, UDP or no protocol, and all calls of other architectures
// (32-bit, x32); calls newer than Linux 6.1 do not exist behind it. InvalidArgumentError names an
// unknown system call.
absl::StatusOr<Fd> MakeSeccompFilter(const PolicySandboxConfig& config);

}  // namespace myograde::server
