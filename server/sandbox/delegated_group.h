// A service manager's control group that is this process' own to divide.
#pragma once

#include <absl/status/status.h>

#include "server/sandbox/cgroup_host.h"

namespace myograde::server {

// If a service manager has delegated this process' own group of version 2 to it (systemd's
// Delegate=): moves this process into a group `daemon` in it and passes memory, pids and cpu on, as
// far as they are there, so that ControlGroup can make the sandboxes' groups beside it. Version 2
// has no processes in a group whose children have controllers, and systemd only from 254 on makes
// such a group itself. Otherwise does nothing. Call while this process has no
// children, which would stay behind.
// FailedPreconditionError: the group was delegated but can't be divided; this process stays in it.
absl::Status DivideDelegatedGroup(const CgroupHost& host = ThisCgroupHost());

}  // namespace myograde::server
