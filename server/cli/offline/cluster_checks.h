// The checks of `myograde doctor --cluster`, of the Slurm cluster of server.json.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "protocol/lease/track_config.h"
#include "server/config/server_config.h"
#include "server/sandbox/doctor.h"

namespace myograde::server {

struct ClusterSubject {
  ServerConfig config;
  std::string bin_dir;    // this host's; absolute, as are all folders
  std::string cache_dir;
  // Whose budgets a job gets where the config leaves them to the track; unset if none can be read.
  std::optional<TrackConfig> track;
};

// Runs every check, in a fixed order, with Slurm's own commands, each of which has a deadline; those
// that need a controller are left out where none answers. The last one runs a job of seconds on one
// node. Leaves nothing behind.
std::vector<Check> ExamineCluster(const ClusterSubject& subject);

}  // namespace myograde::server
