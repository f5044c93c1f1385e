// The command of a policy's sandbox: the bridge, which starts the participant's program, or an
// adapter (server/artefact/adapters.h) that does so.
#pragma once

#include <string>
#include <vector>

#include "protocol/lease/lease.h"
#include "server/sandbox/sandbox_config.h"

namespace myograde::server {

// Where a policy's sandbox shows the adapter of its order.
inline constexpr char kAdapterPlace[] = "/myograde/adapter";

// `bridge`: its place in the sandbox. The policy's variables are set through it, so that none of
// them affects a program that is not the participant's.
std::vector<std::string> BridgeCommand(const LeaseOrder& order, const PolicySandboxConfig& config,
                                       const std::string& bridge);

// Why the kernel would not start the command; "": nothing. Uploads have smaller bounds, artefacts
// of an import may not.
std::string TooLong(const std::vector<std::string>& command);

}  // namespace myograde::server
