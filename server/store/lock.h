// Allows one daemon at a time on a data folder.
#pragma once

#include <string>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde::server {

// Held while this object lives; the kernel releases it when the process dies in any way.
class DataLock {
 public:
  // Locks DIR/artefacts, which stays the same whoever tidies up in DIR, and DIR/lock, which has the
  // holder's process id and which daemons of earlier versions lock alone. FailedPreconditionError,
  // with that process id, if another daemon has it; ResourceExhaustedError if the disk is full;
  // PermissionDeniedError or InternalError if the file can't be created. Nothing else was written.
  static absl::StatusOr<DataLock> Take(const std::string& dir);

 private:
  DataLock(Fd folder, Fd file) : folder_(std::move(folder)), file_(std::move(file)) {}
  Fd folder_;
  Fd file_;
};

}  // namespace myograde::server
