#include "server/cli/offline/stop_signal.h"

#include <signal.h>

#include <initializer_list>

namespace myograde::server {
namespace {

volatile sig_atomic_t g_stop_requested = 0;

void OnStopSignal(int) { g_stop_requested = 1; }

}  // namespace

void CatchStopSignals() {
  struct sigaction action = {};
  action.sa_handler = OnStopSignal;  // no SA_RESTART, so that poll returns
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) ::sigaction(signal, &action, nullptr);
}

bool StopRequested() { return g_stop_requested != 0; }

}  // namespace myograde::server
