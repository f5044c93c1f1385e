// Whole files, and whole texts into descriptors.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

namespace myograde {

inline constexpr size_t kAnySize = static_cast<size_t>(-1);

// What is left to read of a descriptor. Never throws: a file of /proc whose process has ended is
// an error like any other. `name` is told in errors. UnavailableError if reading fails,
// InvalidArgumentError if there is more than `max_bytes`.
absl::StatusOr<std::string> ReadAll(int fd, const std::string& name, size_t max_bytes = kAnySize);

// The content of a file, also of one that tells no size. NotFoundError if it can't be opened, else
// as above.
absl::StatusOr<std::string> ReadFile(const std::string& path, size_t max_bytes = kAnySize);

// Writes all of `text`; the kernel's error if it can't.
absl::Status WriteAll(int fd, std::string_view text);

// Makes a file or replaces its content. InvalidArgumentError with the reason.
absl::Status WriteFile(const std::string& path, std::string_view text);

}  // namespace myograde
