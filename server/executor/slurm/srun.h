// What one lease's job asks of the cluster.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <absl/time/time.h>

#include "protocol/lease/track_config.h"
#include "server/config/slurm_config.h"

namespace myograde::server {

// Leases with equal needs can share a job array.
struct JobNeeds {
  int64_t minutes = 0;
  int64_t memory_mib = 0;
  int64_t cpus = 0;

  bool operator==(const JobNeeds&) const = default;
};

// Of a lease of a track with these budgets, which may take `wall`: what the config says, and what it
// leaves open by the budgets.
JobNeeds NeedsOf(const SlurmConfig& config, const Budgets& budgets, absl::Duration wall);

// Words of sbatch(1) and srun(1): the config's options, and the needs. Later words win, so that no
// option of the config can change the needs.
std::vector<std::string> JobWords(const SlurmConfig& config, const JobNeeds& needs);

}  // namespace myograde::server
