// Files as memory.
#pragma once

#include <string>
#include <string_view>
#include <utility>

#include <absl/status/statusor.h>

namespace myograde::sim {

// A file's content without a copy of it. Whoever writes such files gives them
// another name first: one that shrinks under its reader ends the process.
class MappedFile {
 public:
  // NotFoundError if it can't be opened, DataLossError if it can't be mapped.
  static absl::StatusOr<MappedFile> Open(const std::string& path);
  MappedFile(MappedFile&& other) noexcept : content_(std::exchange(other.content_, {})) {}
  MappedFile& operator=(MappedFile&&) = delete;
  ~MappedFile();

  std::string_view content() const { return content_; }

 private:
  explicit MappedFile(std::string_view content) : content_(content) {}
  std::string_view content_;
};

}  // namespace myograde::sim
