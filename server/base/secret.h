// Secrets: random ones, and those that an operator keeps in files.
#pragma once

#include <cstddef>
#include <string>

#include <absl/status/statusor.h>

namespace myograde::server {

// `size` bytes that nobody can guess, from OpenSSL's generator. InternalError: the host gives none.
absl::StatusOr<std::string> RandomBytes(size_t size);

// The text of a file, without the line feed at its end. InvalidArgumentError, in one sentence that
// says what to do, if it can't be read, is not a regular file, may be read or written by others than
// its owner, or is not `min` to `max` bytes of printable ASCII.
absl::StatusOr<std::string> ReadSecretFile(const std::string& path, size_t min, size_t max);

}  // namespace myograde::server
