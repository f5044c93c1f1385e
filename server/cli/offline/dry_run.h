// myograde submit --dry-run: what would fail on the server, found before anything is sent.
#pragma once

#include <cstdint>

#include "server/cli/base/options.h"
#include "server/cli/client/submit.h"

namespace myograde::server {

struct DryRunOptions : SubmitOptions {
  bool dry_run = false;
  int64_t phase_episodes = 0;  // of a ranked submission to the phase, as the server says; 0: unknown
  HostOptions host;
};

// Checks the submission here, asks the server whether it would accept it, plays one practice
// episode with all limits on, and reports everything. The exit status: kNoScore if anything would fail;
// else kUnreachable if the server did not answer, kTrouble if this host could not play; else kDone.
// Options that can't be used, and a phase without a server that knows it, are errors.
int DryRun(DryRunOptions options);

}  // namespace myograde::server
