// Opens files that a person names.
#pragma once

#include <string>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde {

// Opens a file for reading. Never waits: a named pipe that nobody writes to, a device or a folder is
// an InvalidArgumentError that says what it is. What this process was started with (/dev/stdin,
// /dev/fd/N) may be a pipe. NotFoundError if it can't be opened.
absl::StatusOr<Fd> OpenToRead(const std::string& path);

}  // namespace myograde
