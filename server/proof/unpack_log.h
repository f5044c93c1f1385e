// Logs of episodes as the server's programs read them.
#pragma once

#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/log/episode_log.h"
#include "protocol/log/packed_log.h"

namespace myograde::server {

// Reads the file of a log, packed or not. NotFoundError if it can't be opened,
// else as ReadPackedLog.
absl::StatusOr<std::string> ReadLog(const std::string& path);

// DataLossError if a log's SHA-256 is `found` in place of that which its record names.
absl::Status CheckLogHash(const std::string& named, const std::string& found);

}  // namespace myograde::server
