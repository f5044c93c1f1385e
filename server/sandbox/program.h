// Checks whether a submission's command can start in a policy's sandbox, before anything runs.
#pragma once

#include <string>
#include <vector>

#include <absl/status/status.h>

#include "server/artefact/artefact.h"

namespace myograde::server {

// Resolves the command of `manifest` as the sandbox would on this host: through PATH if it is a
// bare word, symbolic links, a script's interpreter, a binary's dynamic loader, and the pyvenv.cfg
// of a virtual environment. `folder`: the unpacked submission; links in it are never followed by
// this process. `runtimes`: the host folders of manifest.runtimes. InvalidArgumentError: it can't
// start; names the missing file and what to do.
absl::Status CheckProgram(const PolicyManifest& manifest, const std::string& folder,
                          const std::vector<std::string>& runtimes);

}  // namespace myograde::server
