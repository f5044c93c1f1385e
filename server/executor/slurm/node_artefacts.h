// The submissions that a node has unpacked: each once, for all leases that play it there, and the
// least recently used go when they take too much of the disk.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "server/artefact/artefact_stream.h"

namespace myograde::server {

// An unpacked submission, which stays as long as this object does.
class HeldArtefact {
 public:
  HeldArtefact(std::string folder, Fd lock) : folder_(std::move(folder)), lock_(std::move(lock)) {}
  const std::string& folder() const { return folder_; }

 private:
  std::string folder_;
  Fd lock_;  // shared
};

class NodeArtefacts {
 public:
  // Below `node_dir`, which must be there. `most_bytes`: of all that no lease plays.
  explicit NodeArtefacts(std::string node_dir, int64_t most_bytes = int64_t{20} << 30)
      : folder_(std::move(node_dir) + "/artefacts"), most_bytes_(most_bytes) {}

  // Unpacks the submission of that digest unless it is there. Waits for another lease that does the
  // same, for `patience` at most (DeadlineExceededError). Errors as of PlaceStreamedArtefact.
  absl::StatusOr<HeldArtefact> Hold(const std::string& digest, const ByteSource& source,
                                    absl::Duration patience = absl::Minutes(10)) const;

 private:
  absl::Status Unpack(const std::string& digest, const ByteSource& source) const;
  void MakeRoom() const;
  std::string LockPath(const std::string& digest) const;

  const std::string folder_;
  const int64_t most_bytes_;
};

}  // namespace myograde::server
