// Where the secret of a phase's seeds comes from.
#pragma once

#include <string>

#include <absl/status/statusor.h>

namespace myograde::server {

// The secret in a file of its digits, or of the digits themselves.
absl::StatusOr<std::string> GivenSecret(const std::string& digits_or_path);

}  // namespace myograde::server
