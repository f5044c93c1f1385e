// Allows one daemon at a time on a data folder.
#pragma once

#include <string>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde::server {

// Held while this object lives; the kernel releases it when the process dies in any way.
class DataLock {
 public:
  // Takes DIR/lock. FailedPreconditionError, with the holder's process id, if another daemon has
  // it; PermissionDeniedError or InternalError if the file can't be created.
  static absl::StatusOr<DataLock> Take(const std::string& dir);

 private:
  explicit DataLock(Fd fd) : fd_(std::move(fd)) {}
  Fd fd_;
};

}  // namespace myograde::server
