// The system call filter of a sandbox, as a program for bubblewrap's --seccomp.
#pragma once

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "server/sandbox/sandbox_config.h"

namespace myograde::server {

// A memory file with the BPF program, at its start. Allows what the config does
// not deny. Whatever the config says, it denies new namespaces through clone,
// terminal injection, news of other users of a shared file (leases, locks, hints
// in its inode, directory notification), foreign execution domains, the sharing of cores by cookie,
// sockets other than streams, datagrams and packets over TCP, UDP or none, and
// all calls of other architectures (32-bit, x32); calls newer than Linux 6.1 do
// not exist behind it. InvalidArgumentError names a system call that does not
// exist.
absl::StatusOr<Fd> MakeSeccompFilter(const PolicySandboxConfig& config);

}  // namespace myograde::server
