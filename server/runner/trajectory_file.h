// The trajectory of a replayed episode on its way out of the simulator's sandbox: a memory file that
// the simulator maps, as it can write no other, and the file that its content is kept in.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde::server {

class TrajectoryFile {
 public:
  // Creates `path`, which must not exist yet, and the memory file.
  static absl::StatusOr<TrajectoryFile> Make(const std::string& path);

  // Of a fixed size, kMostTrajectoryFileBytes, which nobody can change.
  int memory() const { return memory_.get(); }

  // Copies the first `bytes` of the memory file to the file. InternalError: there can't be so many, or
  // the copy fails; nothing is kept then.
  absl::Status Keep(int64_t bytes);

 private:
  TrajectoryFile(std::string path, Fd file, Fd memory)
      : path_(std::move(path)), file_(std::move(file)), memory_(std::move(memory)) {}
  std::string path_;
  Fd file_;
  Fd memory_;
};

}  // namespace myograde::server
