// A node's proof that its results are the daemon's: its grader's build, the reference episodes played
// on it, and what the doctor misses.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/statusor.h>

#include "server/executor/slurm/lease_ends.h"

namespace myograde::server {

struct ProofOptions : NodeOptions {
  std::string adapter = {};  // whose files are part of the build; "": none's
  int64_t uid_base = -1;     // of the sandboxes; -1: none
  bool again = false;        // whatever is known of an earlier proof
};

// The node's name: what the cluster calls it (SLURMD_NODENAME), else this host's, with "-" for what
// no name may have.
std::string NodeName();

// As the kernel names it; "unknown": it does not.
std::string ProcessorName();

// Why this node must not play for a daemon whose GraderBuild is `grader` (canonical JSON), in one
// sentence without a subject; "": it may. Unless it has proved itself since it booted, with this build,
// the host is examined and the reference episodes are played, which takes up to a minute; one process
// of the node at a time. An error: it can't be told. REQUIRES: a single thread.
absl::StatusOr<std::string> WhyUnfit(const ProofOptions& options, const std::string& grader);

// Why the build `found` is not `expected` (as canonical JSON), to follow "its": one part that
// differs. "" if they are equal.
std::string BuildDifference(const std::string& expected, const std::string& found);

}  // namespace myograde::server
