// How an adapter (server/artefact/adapters.h) is started inside a policy's sandbox, and with it the
// participant's own program.
#pragma once

#include <string>
#include <vector>

#include "protocol/lease/lease.h"

namespace myograde::server {

// Where a policy's sandbox shows the adapter of its order.
inline constexpr char kAdapterPlace[] = "/myograde/adapter";

// The adapter's own variables, as "NAME=value".
std::vector<std::string> AdapterEnvironment(const LeaseOrder& order);

// The command that the bridge starts: the adapter, which starts order.command with `variables`
// ("NAME=value") once it listens. REQUIRES: order.adapter is not empty.
std::vector<std::string> AdapterCommand(const LeaseOrder& order,
                                        const std::vector<std::string>& variables);

}  // namespace myograde::server
