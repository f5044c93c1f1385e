// Brings an episode's log from the spool into the daemon's folder of logs.
#pragma once

#include <string>

#include <absl/status/status.h>

#include "protocol/tracks/episode_facts.h"
#include "server/executor/spool/lease_folder.h"

namespace myograde::server {

// Copies the log that a record names, checks on the way that it is that log, and puts it into `logs`
// under its name, on disk on return. `draft` makes the name of the unfinished file unique.
// NotFoundError, UnavailableError: it is not there, or not yet as a whole. DataLossError: it is not
// the log of the record. ResourceExhaustedError, InternalError: `logs` does not take it.
absl::Status TakeLog(const LeaseFolder& lease, const EpisodeLogInfo& info, const std::string& logs,
                     const std::string& draft);

}  // namespace myograde::server
