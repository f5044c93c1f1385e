// Asks for a secret.
#pragma once

#include <absl/status/statusor.h>

#include <string>

namespace myograde::server {

// One line of standard input: on a terminal after `prompt` and without showing what is typed.
// InvalidArgumentError: there is none.
absl::StatusOr<std::string> ReadSecret(const std::string& prompt);

}  // namespace myograde::server
