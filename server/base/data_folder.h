// The data folder: one daemon at a time works on it, and the store records which folder it is at
// home in, so that a copy can be told from it.
#pragma once

#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde::server {

// Held while this object lives; the kernel releases it when the process dies in any way.
class DataLock {
 public:
  // Locks DIR/artefacts, which stays the same whoever tidies up in DIR, and DIR/lock, which has the
  // holder's process id. FailedPreconditionError, with that process id, if another daemon has it;
  // ResourceExhaustedError if the disk is full; PermissionDeniedError or InternalError if the file
  // can't be created. Nothing else was written.
  static absl::StatusOr<DataLock> Take(const std::string& dir);

 private:
  DataLock(Fd folder, Fd file) : folder_(std::move(folder)), file_(std::move(file)) {}
  Fd folder_;
  Fd file_;
};

struct DataHome {
  // 64 hexadecimal digits, other ones for each copy, on any host. A folder that is renamed on its
  // disk keeps them.
  std::string key;
  std::string place;  // "PATH on host NAME", for people
};

// Of the folder `dir`. UnavailableError if it can't be examined.
absl::StatusOr<DataHome> ReadDataHome(const std::string& dir);

}  // namespace myograde::server
