// The runtimes of a server, against those that a policy.json names.
#pragma once

#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/cli/client/client.h"

namespace myograde::server {

// Their names, sorted. Errors as Client::Get.
absl::StatusOr<std::vector<std::string>> OfferedRuntimes(const Client& client);

// A sentence on the first of `named` that is not offered; "" if all are.
std::string MissingRuntime(const std::vector<std::string>& named,
                           const std::vector<std::string>& offered);

// Asks the server before an upload whether it has the runtimes of the submission at `path`.
// InvalidArgumentError: it lacks one, or policy.json can't be used. A single file names none, and what
// an archive names the server says after the upload.
absl::Status CheckRuntimesOffered(const Client& client, const std::string& path);

}  // namespace myograde::server
