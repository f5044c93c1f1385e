// Where the secret of a phase's seeds comes from.
#pragma once

#include <optional>
#include <string>

#include <absl/status/statusor.h>

#include "server/cli/client/client.h"

namespace myograde::server {

// The secret in a file of its digits, or of the digits themselves.
absl::StatusOr<std::string> GivenSecret(const std::string& digits_or_path);

// What the daemon says of a phase that it has revealed; nullopt if it has not, or can't be asked.
std::optional<std::string> RevealedSecret(const Client& client, const std::string& phase);

}  // namespace myograde::server
