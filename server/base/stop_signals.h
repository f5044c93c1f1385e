// Signals that ask a program to end, as something to poll.
#pragma once

#include "protocol/base/fd.h"

namespace myograde::server {

// From now on SIGTERM, SIGINT and SIGHUP make this descriptor (signalfd(2)) readable, in this thread
// and those that it starts, and SIGPIPE is ignored.
Fd StopSignals();

}  // namespace myograde::server
