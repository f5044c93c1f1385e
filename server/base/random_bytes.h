// Random bytes for secrets.
#pragma once

#include <cstddef>
#include <string>

#include <absl/status/statusor.h>

namespace myograde::server {

// `size` bytes that nobody can guess, from OpenSSL's generator. InternalError: the host gives none.
absl::StatusOr<std::string> RandomBytes(size_t size);

}  // namespace myograde::server
