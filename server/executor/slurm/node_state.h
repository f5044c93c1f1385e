// What a node of a cluster is: its name, and its proof that its results are the daemon's, which are
// its grader's build, the reference episodes played on it, and what the doctor misses. And what its
// folder holds, which several jobs may share: slots to play leases in, and the submissions that it
// has unpacked. Each is held by a lock that the kernel releases when the process ends.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "protocol/lease/lease.h"
#include "server/artefact/artefact.h"
#include "server/executor/slurm/lease_stream.h"
#include "server/sandbox/slot_processes.h"

namespace myograde::server {

// The node's name: what the cluster calls it (SLURMD_NODENAME), else this host's, with "-" for what
// no name may have.
std::string NodeName();

// As the kernel names it; "unknown": it does not.
std::string ProcessorName();

// Why this node must not play for the daemon that has sent the order, in one sentence without a
// subject; "": it may. Unless it has proved itself since it booted, with this build, and need not
// again, the host is examined and the reference episodes are played, which takes up to a minute;
// one process of the node at a time. An error: it can't be told. REQUIRES: a single thread.
absl::StatusOr<std::string> WhyUnfit(const NodeOptions& options, const ClusterOrder& order);

// Why the build `found` is not `expected` (as canonical JSON), to follow "its": one part that
// differs. "" if they are equal.
std::string BuildDifference(const std::string& expected, const std::string& found);

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

  const std::string& work_dir() const { return work_dir_; }

 private:
  NodeSlot(int number, Fd lock, std::string work_dir, const SlotProcesses& processes)
      : number_(number),
        lock_(std::move(lock)),
        work_dir_(std::move(work_dir)),
        processes_(processes) {}

  int number_;
  Fd lock_;
  std::string work_dir_;
  SlotProcesses processes_;
};

// An unpacked submission, which stays as long as this value does.
struct HeldArtefact {
  std::string folder;
  Fd lock;  // shared
};

// The submission of that digest, below `node_dir`, which must be there: unpacked once for all
// leases that play it on the node. Those that no lease plays go, the least recently used first,
// while all have more than `most_bytes`. Waits for another lease that unpacks the same
// (DeadlineExceededError: for too long). Errors as of PlaceStreamedArtefact.
absl::StatusOr<HeldArtefact> HoldArtefact(const std::string& node_dir, const std::string& digest,
                                          const ByteSource& source,
                                          int64_t most_bytes = int64_t{20} << 30);

}  // namespace myograde::server
