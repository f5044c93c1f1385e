// Builds the two kinds of sandboxes of a lease. Nothing else does. The sandbox of a container image
// shows the image's files at the top, where other policies see the host's; the grader's own
// programs in it run with the host's loader and libraries (image_sandbox.cc).
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

// Where the sandbox of an image shows the host's /usr.
inline constexpr char kHostPlace[] = "/myograde/host";

// Where a program of this host is found and how it is started in an image's sandbox: by the host's
// dynamic loader, with libraries of the host's only. Neither the image's loader, its ld.so.cache nor
// its libraries have a part in it. `program`: a path of the host below /usr; it is told the place at
// which the sandbox shows it, so that Python finds its modules. Append the arguments.
std::vector<std::string> HostCommand(const std::string& program);

// The same for a program at `path` in the sandbox that was built for this host.
std::vector<std::string> LoaderCommand(const std::string& path, const std::string& name);

// Adds the mounts of an image's files, which lie in the staged artefact's kImageFolder, and of the
// host's /usr at /myograde/host. Folders in which one of `order.runtimes` is mounted are made of
// their parts. InvalidArgumentError: only the image can be the reason, with what to do about it;
// FailedPreconditionError: this host can't read the files.
absl::Status AddImage(const LeaseOrder& order, const Stage& stage, SandboxSpec& spec);

// Whether AddImage will succeed for the image in the folder `root`, with the same errors.
absl::Status CheckImageMounts(int root, const std::vector<std::string>& runtimes);

// Where the image's command is looked up, in this order.
std::vector<std::string> ImagePath(const PolicyImage& image);

}  // namespace myograde::server
