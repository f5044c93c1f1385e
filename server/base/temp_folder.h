// Temporary folders.
#pragma once

#include <sys/types.h>

#include <string>
#include <utility>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde::server {

// A folder below TMPDIR that is removed with everything in it: at the end of its life, or by a small
// process that waits for it when this process is ended by any signal.
class TempFolder {
 public:
  static absl::StatusOr<TempFolder> Make(const std::string& purpose);
  TempFolder(TempFolder&& other) noexcept
      : path_(std::exchange(other.path_, "")),
        alive_(std::move(other.alive_)),
        remover_(std::exchange(other.remover_, -1)) {}
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;
  ~TempFolder();
  const std::string& path() const { return path_; }

 private:
  explicit TempFolder(std::string path) : path_(std::move(path)) {}
  std::string path_;
  Fd alive_;            // closed by the kernel when this process ends
  pid_t remover_ = -1;  // -1: none could be started
};

}  // namespace myograde::server
