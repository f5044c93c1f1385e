// The two kinds of sandboxes of a lease, each built here and nowhere else.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "protocol/lease/lease.h"
#include "server/sandbox/control_group.h"
#include "server/sandbox/sandbox.h"
#include "server/sandbox/sandbox_config.h"
#include "server/sandbox/stage.h"

namespace myograde::server {

// Small files that a C library expects, staged once for a lease.
struct EtcFiles {
  std::string passwd;
  std::string group;
  std::string hosts;
};
absl::StatusOr<EtcFiles> StageEtcFiles(const Stage& stage);

// What a lease's sandboxes need to be staged: programs, artefact, runtimes, cache, the
// slot's mark.
std::vector<std::string> StagedSources(const LeaseOrder& order, const std::string& bin_dir);

// The order's folders that no sandbox could be built with: relative paths, or
// runtimes that would hide a part of the sandbox itself.
absl::Status CheckOrderPaths(const LeaseOrder& order);

// Where a policy's command without a slash is looked up, in this order: the bin folders of its
// `runtimes` (host folders, which lie at the same place in the sandbox), then the system's.
std::vector<std::string> PolicyPath(const std::vector<std::string>& runtimes);

// What a policy's sandbox has of the host's own, each at its own place, and the names beside /usr
// that lead into it ("bin" for /bin, a link to usr/bin).
std::vector<std::string> SystemPlaces();
std::vector<std::string> SystemLinks();

// The participant's: bridge as process 1, the artefact at /policy. `scratch`: of
// Stage::MountScratch. `group` tells which limits the kernel already enforces;
// for the others there are rlimits.
SandboxSpec MakePolicySandbox(const LeaseOrder& order, const PolicySandboxConfig& config,
                              const std::string& bin_dir, const Stage& stage, const EtcFiles& etc,
                              const std::string& scratch, const GroupControllers& group);

// The limits of the participant's control group.
GroupLimits PolicyGroupLimits(const Budgets& budgets);

// The limits of the simulator's control group.
GroupLimits SimGroupLimits(const SimSandboxConfig& config);

// The simulator's: no network, all read-only, a user beside the policy's.
SandboxSpec MakeSimSandbox(const LeaseOrder& order, const SimSandboxConfig& config,
                           const std::string& bin_dir, const Stage& stage, const EtcFiles& etc);

}  // namespace myograde::server
