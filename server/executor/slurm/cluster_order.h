// The order of a lease on a cluster: a file from the daemon to the process that looks after the lease
// on its host, which sends it on to the node as it is.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/lease/lease.h"

namespace myograde::server {

// Of LeaseOrder::runtimes, at the same place there.
struct ClusterRuntime {
  std::string name;
  std::string digest;  // "": it is a folder that nothing describes
};

struct ClusterOrder {
  // With the daemon's folders, which a node replaces by its own, as it does user and slot.
  LeaseOrder order;
  std::string artefact;  // digest of the files in order.artefact_dir
  std::vector<ClusterRuntime> runtimes;
  std::string grader;    // the daemon's GraderBuild with the order's adapter, as canonical JSON
  int64_t uid_base = -1;  // first of the sandboxes' users where root runs the node; -1: none
  std::vector<std::string> prove_again;  // nodes that must, whatever they remember of an earlier proof

  // For the daemon's host.
  std::string comment;              // of this one alone
  std::vector<std::string> srun;    // words of the command line, with the node's program
  std::vector<std::string> squeue;  // words that show this store's jobs, those that are over too
  absl::Duration queue_wait;        // until a node must have begun it
};

std::string ClusterOrderToText(const ClusterOrder& order);
// InvalidArgumentError: which key is wrong, and how.
absl::StatusOr<ClusterOrder> ClusterOrderFromText(std::string_view text);

}  // namespace myograde::server
