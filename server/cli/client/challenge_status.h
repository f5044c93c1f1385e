// myograde challenge status
#pragma once

#include "server/cli/client/daemon_options.h"

namespace myograde::server {

// Prints what is open, for how long, and what waits; returns the exit status.
int ChallengeStatus(const DaemonOptions& options);

}  // namespace myograde::server
