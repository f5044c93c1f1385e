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
  // Of sbatch(1); "": the cluster's defaults.
  std::string partition;
  std::string account;
  std::string qos;
  std::string constraint;
  std::string reservation;
  std::vector<std::string> extra_options;  // words for sbatch, before the daemon's own
  // Of one lease's job; 0: derived from its track's budgets.
  int time_limit_min = 0;
  int64_t memory_mib = 0;
  int cpus = 0;
  int most_jobs = 64;    // waiting or running at once
  int array_size = 100;  // most tasks of a job array
  // A folder that the daemon and all nodes see at this path; "": nodes use HTTPS, at `url`.
  std::string shared_dir;
  std::string url;      // "https://HOST:PORT"
  std::string ca_file;  // on the nodes; "": theirs
  // On the nodes.
  std::string bin_dir;    // "": as the daemon's
  std::string cache_dir;  // "": as the daemon's
  std::string node_dir;   // private to each node
  std::string slurm_bin_dir;  // of sbatch, squeue and scancel; "": found in PATH
  // A job that has not begun by then is cancelled, and its lease returned.
  absl::Duration queue_wait = absl::Hours(1);
  // A job that runs and has not taken its lease by then.
  absl::Duration claim = absl::Minutes(3);
  absl::Duration poll = absl::Seconds(2);  // between two questions to the cluster
};

// The object at `slurm`; keys that are left out have the values above.
absl::StatusOr<SlurmConfig> ReadSlurm(const nlohmann::json& json, const std::string& where);

// InvalidArgumentError unless it says how nodes get their leases. Asked only where leases run on the
// cluster.
absl::Status CheckSlurmIsUsable(const SlurmConfig& config, const std::string& where);

// What Slurm's commands get of this process' environment, "NAME=VALUE" each: what finds and signs in to
// the cluster. Their other variables (SQUEUE_PARTITION, SBATCH_ACCOUNT, SCANCEL_STATE, SLURM_CLUSTERS)
// change what they show or do, and the bookkeeping relies on that.
std::vector<std::string> SlurmEnvironment();

}  // namespace myograde::server
