// A place for one lease on a node that several jobs may share: its users of the sandboxes, and a
// folder to work in. Held by a lock that the kernel releases when the process ends.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/clock.h"
#include "protocol/base/fd.h"
#include "protocol/lease/lease.h"

namespace myograde::server {

// A file of a node's to lock by flock(2), made if it is not there. Errors of HostError.
absl::StatusOr<Fd> OpenLock(const std::string& path);
// Takes the lock: LOCK_SH or LOCK_EX. DeadlineExceededError(`why`): another process has it for too long.
absl::Status TakeLock(const Fd& lock, int how, const Deadline& deadline, const std::string& why);

class NodeSlot {
 public:
  // The first free slot of the node whose folder is `node_dir`, which must be there. `uid_base`: first
  // of the sandboxes' users (server/sandbox/users.h), which root needs and others don't have.
  // InvalidArgumentError: root, without them. ResourceExhaustedError: none is free.
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

}  // namespace myograde::server
