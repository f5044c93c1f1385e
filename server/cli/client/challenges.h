// The challenges of a daemon and their phases.
#pragma once

#include <absl/status/statusor.h>

#include <string>

#include "server/cli/client/daemon_options.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {

// The phase called `name` in an answer of GET /v1/challenges; null if there is none.
Json PhaseIn(const Json& answer, const std::string& name);

// A phase as GET /v1/challenges has it. InvalidArgumentError: there is none of that name; else an
// error of the client.
absl::StatusOr<Json> FindPhaseOf(const Client& client, const std::string& phase);

// myograde challenge status: prints what is open, for how long, and what waits.
absl::StatusOr<int> ChallengeStatus(const DaemonOptions& options);

}  // namespace myograde::server
