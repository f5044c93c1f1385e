// Where this daemon's leases run, by server.json.
#pragma once

#include <memory>
#include <string>

#include <absl/status/statusor.h>

#include "server/config/server_config.h"
#include "server/daemon/daemon.h"
#include "server/daemon/start.h"
#include "server/executor/executor.h"
#include "server/executor/lease_door.h"

namespace myograde::server {

struct LeaseHosts {
  std::unique_ptr<Executor> executor;
  // How nodes fetch leases by HTTPS; nullptr: there is no such way. Of the executor.
  LeaseDoor* door = nullptr;
};

// `secret`, the store's policy secret, and its home tell its jobs and its spool from another's, copies
// of the same store included.
absl::StatusOr<LeaseHosts> MakeLeaseHosts(const DaemonOptions& options, const ServerConfig& config,
                                          const std::string& secret, const HomeFound& home);

}  // namespace myograde::server
