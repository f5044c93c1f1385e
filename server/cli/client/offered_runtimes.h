// The runtimes of a server, against those that a policy.json names.
#pragma once

#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "server/cli/client/client.h"

namespace myograde::server {

// Their names, sorted. Errors as Client::Get.
absl::StatusOr<std::vector<std::string>> OfferedRuntimes(const Client& client);

// A sentence on the first of `named` that is not offered; "" if all are.
std::string MissingRuntime(const std::vector<std::string>& named,
                           const std::vector<std::string>& offered);

}  // namespace myograde::server
