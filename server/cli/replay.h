// Playing logs again on this host.
#pragma once

#include <map>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/log/episode_log.h"
#include "server/cli/common.h"
#include "server/proof/replay_run.h"

namespace myograde::server {

struct ReplayLogFile {
  std::string path;  // packed or not
  LogHeader header;
};

// Plays logs, by episode, all of one config, and returns their records in order.
// Where state carries over between episodes, all of a lease before one must be
// there. `slots` 0: as server.json says.
absl::StatusOr<std::vector<ReplayRecord>> PlayLogs(const std::map<int64_t, ReplayLogFile>& files,
                                                   const HostOptions& host, int slots);

}  // namespace myograde::server
