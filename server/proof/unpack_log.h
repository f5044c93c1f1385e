// Logs of episodes as the server's programs read them.
#pragma once

#include <string>
#include <string_view>

#include <absl/status/statusor.h>

#include "protocol/episode_log.h"
#include "protocol/packed_log.h"

namespace myograde::server {

// Reads the file of a log, packed or not. NotFoundError if it can't be opened,
// else as ReadPackedLog.
absl::StatusOr<std::string> ReadLog(const std::string& path);

// Unpacks a log and holds it against the hash that its record names:
// DataLossError if it is another.
absl::StatusOr<std::string> UnpackLogOf(const std::string& sha256, std::string_view packed);

}  // namespace myograde::server
