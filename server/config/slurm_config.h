// What server.json says of a Slurm cluster on which leases run.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>
#include <nlohmann/json.hpp>

namespace myograde::server {

struct SlurmConfig {
  // Of srun(1); "": the cluster's defaults.
  std::string partition;
  std::string account;
  std::string qos;
  std::string constraint;
  std::string reservation;
  std::vector<std::string> extra_options;  // words for srun, before the daemon's own
  // Of one lease's job; 0: derived from its track's budgets.
  int time_limit_min = 0;
  int64_t memory_mib = 0;
  int cpus = 0;
  int most_jobs = 64;    // waiting or running at once
  // On the nodes.
  std::string bin_dir;    // "": as the daemon's
  std::string cache_dir;  // "": as the daemon's
  std::string node_dir;   // private to each node
  std::string slurm_bin_dir;  // of srun, squeue, scancel and sinfo; "": found in PATH
  // A job that has not begun by then is cancelled, and its lease returned.
  absl::Duration queue_wait = absl::Hours(1);
};

// The object at `slurm`; keys that are left out have the values above.
absl::StatusOr<SlurmConfig> ReadSlurm(const nlohmann::json& json, const std::string& where);

// What Slurm's commands get of this process' environment, "NAME=VALUE" each: what finds and signs in to
// the cluster. Their other variables (SQUEUE_PARTITION, SLURM_ACCOUNT, SCANCEL_STATE, SLURM_CLUSTERS)
// change what they show or do.
std::vector<std::string> SlurmEnvironment();

}  // namespace myograde::server
