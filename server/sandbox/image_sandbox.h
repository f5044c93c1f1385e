// What the sandbox of a container image shows: the image's files at the top, where other policies
// see the host's. The grader's own programs in it run with the host's loader and libraries.
#pragma once

#include <string>
#include <vector>

#include <absl/status/status.h>

#include "protocol/lease/lease.h"
#include "server/sandbox/sandbox.h"
#include "server/sandbox/stage.h"

namespace myograde::server {

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
