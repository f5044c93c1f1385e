// The bridge between the simulator's frames and the policy's LCM bus: a single poll loop. It runs
// as long as its socket to the simulator is open.
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
  // How long a policy may take to exit after the simulator hung up, once asked by SIGTERM. Zero: no
  // time.
  absl::Duration farewell;
};

// Starts `command` and serves until the simulator hangs up (OkStatus). Mistakes of the policy are
// reported to the simulator as a FaultFrame and are not errors here; errors are those of the
// sandbox itself, such as a bus that can't be joined. Blocks SIGCHLD for the process. REQUIRES:
// command.words is not empty.
absl::Status RunBridge(Fd simulator, const BridgeOptions& options, const PolicyCommand& command);

}  // namespace myograde::bridge
