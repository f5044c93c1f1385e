// Reads episode logs for the server's programs.
#pragma once

#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/log/episode_log.h"
#include "protocol/log/packed_log.h"

namespace myograde::server {

// Reads a log file, packed or not. NotFoundError if it can't be opened; otherwise as ReadPackedLog.
absl::StatusOr<std::string> ReadLog(const std::string& path);

// DataLossError if a log's SHA-256, `found`, is not the one that its record names.
absl::Status CheckLogHash(const std::string& named, const std::string& found);

}  // namespace myograde::server
