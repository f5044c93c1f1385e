// Logs of episodes as the server's programs read them.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <absl/status/statusor.h>

#include "protocol/episode_log.h"

namespace myograde::server {

// A log larger than this, unpacked, is refused, as the simulator does.
inline constexpr int64_t kMaxLogBytes = int64_t{512} << 20;

// Unpacks what the runner stored; bytes that are not packed come back as they
// are. DataLossError: damaged, cut or too large.
absl::StatusOr<std::string> UnpackLog(std::string_view packed);

// Reads the file of a log, packed or not, up to kMaxLogBytes. NotFoundError if
// it can't be opened, else as UnpackLog.
absl::StatusOr<std::string> ReadLog(const std::string& path);

// Unpacks a log and holds it against the hash that its record names:
// DataLossError if it is another.
absl::StatusOr<std::string> UnpackLogOf(const std::string& sha256, std::string_view packed);

}  // namespace myograde::server
