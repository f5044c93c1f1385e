// Reading whole files.
#pragma once

#include <string>

#include <absl/status/statusor.h>

namespace myograde::sim {

// The whole content of a file. NotFoundError if it can't be opened,
// DataLossError if reading fails.
absl::StatusOr<std::string> ReadFile(const std::string& path);

}  // namespace myograde::sim
