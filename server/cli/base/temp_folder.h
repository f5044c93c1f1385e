// Temporary folders.
#pragma once

#include <string>
#include <utility>

#include <absl/status/statusor.h>

namespace myograde::server {

// A folder below TMPDIR that is removed with everything in it.
class TempFolder {
 public:
  static absl::StatusOr<TempFolder> Make(const std::string& purpose);
  TempFolder(TempFolder&& other) noexcept : path_(std::exchange(other.path_, "")) {}
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;
  ~TempFolder();
  const std::string& path() const { return path_; }

 private:
  explicit TempFolder(std::string path) : path_(std::move(path)) {}
  std::string path_;
};

}  // namespace myograde::server
