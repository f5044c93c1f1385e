// Reading the file of an episode's log, packed with zstd or not.
#pragma once

#include <string>

#include <absl/status/statusor.h>

namespace myograde::sim {

// A log larger than this, unpacked, is refused. The longest episode of the challenge's tracks
// takes 40 MB.
inline constexpr size_t kMaxLogBytes = 512u << 20;

// Reads `fd` to its end. DataLossError: damaged, or too large.
absl::StatusOr<std::string> ReadLogFile(int fd);

}  // namespace myograde::sim
