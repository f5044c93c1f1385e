// Stopping by Ctrl-C and the like.
#pragma once

namespace myograde::server {

// From now on SIGINT, SIGTERM and SIGHUP end no process but make StopRequested true; system calls
// that wait return early.
void CatchStopSignals();

bool StopRequested();

}  // namespace myograde::server
