// The bridge between the simulator's frames and the policy's LCM bus: a single
// loop around poll. It lives as long as its socket to the simulator.
#pragma once

#include <string>
#include <vector>

#include <absl/status/status.h>

#include "protocol/base/fd.h"
#include "protocol/bridge/inbox.h"

namespace myograde::bridge {

// Starts `command` and serves until the simulator hangs up (OkStatus). What
// the policy does wrong is told to the simulator as a FaultFrame and is no
// error here; errors are those of the sandbox itself, such as a bus that can't
// be joined. Blocks SIGCHLD for the process. REQUIRES: command is not empty.
absl::Status RunBridge(Fd simulator, InboxLimits limits, const std::vector<std::string>& command);

}  // namespace myograde::bridge
