#include "server/daemon/lease_hosts.h"

#include <unistd.h>

#include <utility>
#include <vector>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/paths.h"
#include "server/executor/local/local_executor.h"
#include "server/executor/slurm/slurm_executor.h"
#include "server/proof/grader_build.h"
#include "server/sandbox/sandbox_config.h"

namespace myograde::server {
namespace {

constexpr size_t kStoreIdDigits = 12;

}  // namespace

absl::StatusOr<LeaseHosts> MakeLeaseHosts(const DaemonOptions& options, const ServerConfig& config,
                                          const std::string& secret, const HomeFound& home) {
  const int64_t uid_base = geteuid() == 0 ? config.uid_base : -1;
  if (!config.on_cluster) {
    return LeaseHosts{std::make_unique<LocalExecutor>(
                          SlotProcesses(uid_base, options.data_dir + "/slots")),
                      nullptr};
  }
  ASSIGN_OR_RETURN(const SandboxConfig sandbox, LoadSandboxConfig(options.configs_dir));
  ASSIGN_OR_RETURN(const std::string bin_dir, BinDir());
  absl::StatusOr<std::unique_ptr<SlurmExecutor>> slurm = SlurmExecutor::Make(
      {.config = config.slurm,
       // Shown in the cluster's queue: tells nothing of the secret.
       .store_id = Sha256Hex("a store on a cluster\n" + secret + home.home.key)
                       .substr(0, kStoreIdDigits),
       .held_back = home.held_back,
       .data_dir = options.data_dir,
       .cache_dir = options.cache_dir,
       .configs_dir = options.configs_dir,
       .bin_dir = bin_dir,
       .uid_base = uid_base,
       .log_bytes = sandbox.sim.log_bytes,
       .grader = [cache = options.cache_dir](const std::vector<std::string>& adapters) {
         return GraderBuild(cache, adapters);
       }});
  if (!slurm.ok()) return slurm.status();
  LeaseDoor* const door = (*slurm)->door();
  return LeaseHosts{*std::move(slurm), door};
}

}  // namespace myograde::server
