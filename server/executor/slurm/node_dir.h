// What a node's folder holds, which several jobs may share: slots to play leases in, and the
// submissions that it has unpacked. Each is held by a lock that the kernel releases when the
// process ends.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "protocol/base/fd.h"
#include "protocol/lease/lease.h"
#include "server/artefact/artefact.h"

namespace myograde::server {

// A file of a node's to lock by flock(2), made if it is not there. Errors of HostError.
absl::StatusOr<Fd> OpenLock(const std::string& path);
// Takes the lock: LOCK_SH or LOCK_EX. DeadlineExceededError(`why`): another process has it for too
// long.
absl::Status TakeLock(const Fd& lock, int how, const Deadline& deadline, const std::string& why);

// A place for one lease: its users of the sandboxes, and a folder to work in.
class NodeSlot {
 public:
  // The first free slot of the node whose folder is `node_dir`, which must be there. `uid_base`:
  // first of the sandboxes' users (server/sandbox/slot_processes.h), which root needs and others
  // don't have. InvalidArgumentError: root, without them. ResourceExhaustedError: none is free.
  static absl::StatusOr<NodeSlot> Take(const std::string& node_dir, int64_t uid_base);

  // Gives an order its user, slot, and an empty work folder with the folder logs/ in it.
  absl::Status Prepare(LeaseOrder& order) const;
  // Removes the work folder; what can't be removed is left to the next lease of the slot.
  void CleanUp() const;

  int number() const { return number_; }
  const std::string& work_dir() const { return work_dir_; }

 private:
  NodeSlot(int number, Fd lock, std::string node_dir, int64_t uid_base);

  int number_;
  Fd lock_;
  std::string node_dir_;
  std::string work_dir_;
  int64_t uid_base_;
};

// An unpacked submission, which stays as long as this object does.
class HeldArtefact {
 public:
  HeldArtefact(std::string folder, Fd lock) : folder_(std::move(folder)), lock_(std::move(lock)) {}
  const std::string& folder() const { return folder_; }

 private:
  std::string folder_;
  Fd lock_;  // shared
};

// The submissions that a node has unpacked: each once, for all leases that play it there, and the
// least recently used go when they take too much of the disk.
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
