// Compressed forms of a file, for clients that understand them.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include <absl/status/statusor.h>

namespace myograde::server {

// The same bytes each time.
std::string CompressZstd(std::string_view bytes);
std::string CompressGzip(std::string_view bytes);

// DataLossError: damaged, or more than `most` bytes unpacked.
absl::StatusOr<std::string> UnpackZstd(std::string_view packed, size_t most);

}  // namespace myograde::server
