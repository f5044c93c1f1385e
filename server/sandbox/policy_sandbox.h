// Builds the two kinds of sandboxes of a lease. Nothing else does.
#pragma once

#include <string>
#include <vector>

#include "protocol/lease/lease.h"
#include "server/sandbox/control_group.h"
#include "server/sandbox/sandbox.h"
#include "server/sandbox/sandbox_config.h"
#include "server/sandbox/stage.h"

namespace myograde::server {

// Small files, staged once per lease.
struct EtcFiles {
  std::vector<SandboxMount> etc;     // that a C library expects
  std::vector<SandboxMount> kernel;  // of kernel_files.h, for the policy
};
absl::StatusOr<EtcFiles> StageEtcFiles(const LeaseOrder& order, const Stage& stage);

// The host folders that a lease's sandboxes need staged: programs, artefact, runtimes, cache, the
// slot's mark.
std::vector<std::string> StagedSources(const LeaseOrder& order, const std::string& bin_dir);

// Rejects an order whose folders would make a sandbox impossible: relative paths, or runtimes that
// would hide a part of the sandbox itself.
absl::Status CheckOrderPaths(const LeaseOrder& order);

// Where a policy's command without a slash is looked up, in this order: the bin folders of its
// `runtimes` (host folders, mounted at the same path in the sandbox), then the system's.
std::vector<std::string> PolicyPath(const std::vector<std::string>& runtimes);

// The host folders that a policy's sandbox shows, each at its own path, and the names of links
// beside /usr that lead into it ("bin" for /bin, a link to usr/bin).
std::vector<std::string> SystemPlaces();
std::vector<std::string> SystemLinks();

// The participant's sandbox: bridge as process 1, the artefact at /policy, or the artefact's image as
// the root. `scratch`: from
// Stage::MountScratch. `group` tells which limits the kernel already enforces; the others become
// rlimits.
// What only the artefact can cause makes a sandbox whose policy says why and ends.
// FailedPreconditionError: an image's files can't be read.
absl::StatusOr<SandboxSpec> MakePolicySandbox(const LeaseOrder& order,
                                              const PolicySandboxConfig& config,
                                              const std::string& bin_dir, const Stage& stage,
                                              const EtcFiles& etc, const std::string& scratch,
                                              const GroupControllers& group);

// The limits of the participant's control group.
GroupLimits PolicyGroupLimits(const Budgets& budgets);

// The limits of the simulator's control group.
GroupLimits SimGroupLimits(const SimSandboxConfig& config);

// The simulator's sandbox: no network, everything read-only, its own user beside the policy's.
SandboxSpec MakeSimSandbox(const LeaseOrder& order, const SimSandboxConfig& config,
                           const std::string& bin_dir, const Stage& stage, const EtcFiles& etc);

}  // namespace myograde::server
