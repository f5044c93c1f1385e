// A node's proof that its results are those of every other: its grader build, the reference episodes
// played on it, and what the doctor misses.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

#include <absl/status/statusor.h>

#include "server/executor/spool/forms.h"

namespace myograde::server {

struct ProofOptions {
  std::string cache_dir;
  std::string config_dir;
  std::string node_dir;   // must be there
  std::string node;       // its name
  std::string adapter;    // whose files are part of the build; "": none's
  int64_t uid_base = -1;  // of the sandboxes; -1: none
};

// The node's name: what the cluster calls it (SLURMD_NODENAME), else this host's, with "-" for what
// no name may have.
std::string NodeName();

// Makes the proof: examines the host and plays the reference episodes, which takes from seconds to a
// minute. What is wrong is told in it; an error says why it can't be made. REQUIRES: a single thread.
absl::StatusOr<NodeProof> MakeProof(const ProofOptions& options, const std::atomic<bool>& stop);

// The proof of this boot and this build if it was made before and was good, else a new one, made
// by one process of the node at a time. `again`: a new one in any case.
absl::StatusOr<NodeProof> KnownOrNewProof(const ProofOptions& options, bool again,
                                          const std::atomic<bool>& stop);

// Why the node must not play an order of a daemon with this grader build, in one sentence; "" if it
// may.
std::string WhyNotEqual(const NodeProof& proof, const std::string& grader);

}  // namespace myograde::server
