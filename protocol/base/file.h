// Opens files, and reads and writes whole ones.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde {

inline constexpr size_t kAnySize = static_cast<size_t>(-1);

// The rest of a descriptor's content. Never throws: reading a /proc file of an ended process is an
// ordinary error. `name` appears in errors. UnavailableError if reading fails, InvalidArgumentError
// if there is more than `max_bytes`.
absl::StatusOr<std::string> ReadAll(int fd, const std::string& name, size_t max_bytes = kAnySize);

// Calls `on_line` for each line of the rest of a descriptor's content, without its newline, and its
// number from 1 on, until it returns an error; keeps no more than a line. InvalidArgumentError names
// a line of more than `max_line` bytes, or a last one without a newline. Otherwise as above.
absl::Status ForEachLine(
    int fd, const std::string& name, size_t max_line,
    const std::function<absl::Status(std::string_view line, int64_t number)>& on_line);

// A file's content, even if the file reports no size. NotFoundError if it can't be opened,
// otherwise as above.
absl::StatusOr<std::string> ReadFile(const std::string& path, size_t max_bytes = kAnySize);

// Opens a file that a person names, for reading. Never waits: a named pipe that nobody writes to, a
// device or a folder is an InvalidArgumentError that says what it is. What this process was started
// with (/dev/stdin, /dev/fd/N) may be a pipe. NotFoundError if it can't be opened.
absl::StatusOr<Fd> OpenToRead(const std::string& path);

// A memory file with that content, which is read from its beginning; its descriptor is above the
// standard streams. InternalError if it can't be made.
absl::StatusOr<Fd> MakeMemoryFile(const char* name, std::string_view content);

// Writes all of `text`; otherwise returns the kernel's error.
absl::Status WriteAll(int fd, std::string_view text);

// Creates a file or replaces its content. InvalidArgumentError with the reason.
absl::Status WriteFile(const std::string& path, std::string_view text);

}  // namespace myograde
