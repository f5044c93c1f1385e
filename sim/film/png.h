// PNG files.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include <absl/status/statusor.h>

namespace myograde::sim {

// `rgb`: height x width x 3 bytes, the top row first. Equal pictures have equal bytes. InternalError
// if libpng fails.
absl::StatusOr<std::string> EncodePng(std::span<const uint8_t> rgb, int width, int height);

}  // namespace myograde::sim
