// The bridge between the simulator's frames and the policy's LCM bus: a single
// loop around poll. It lives as long as its socket to the simulator.
#pragma once

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "protocol/bridge/child.h"
#include "protocol/bridge/inbox.h"

namespace myograde::bridge {

// How a bridge serves.
struct BridgeOptions {
  InboxLimits limits;
  // How long a policy may still be about its end after the simulator hung up: it is asked by
  // SIGTERM, and then left so much time at the most. Zero: none.
  absl::Duration farewell;
};

// Starts `command` and serves until the simulator hangs up (OkStatus). What
// the policy does wrong is told to the simulator as a FaultFrame and is no
// error here; errors are those of the sandbox itself, such as a bus that can't
// be joined. Blocks SIGCHLD for the process. REQUIRES: command.words is not empty.
absl::Status RunBridge(Fd simulator, const BridgeOptions& options, const PolicyCommand& command);

}  // namespace myograde::bridge
