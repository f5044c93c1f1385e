// Whether a submission's command can start in a policy's sandbox, told before anything runs.
#pragma once

#include <string>
#include <vector>

#include <absl/status/status.h>

#include "server/artefact/artefact.h"

namespace myograde::server {

// Follows the command of `manifest` as the sandbox would on this host: over the PATH if it is a
// bare word, through symbolic links, a script's interpreter, a binary's dynamic loader, and the
// pyvenv.cfg of a virtual environment. `folder`: the unpacked submission, none of whose links this
// process follows itself. `runtimes`: the host's folders of manifest.runtimes.
// InvalidArgumentError: it can't start, with the file that is missing and what to do.
absl::Status CheckProgram(const ArtefactManifest& manifest, const std::string& folder,
                          const std::vector<std::string>& runtimes);

}  // namespace myograde::server
