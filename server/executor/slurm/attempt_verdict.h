// What follows from what the cluster and the spool show of an attempt: it goes on, is nobody's fault,
// or ends with a fault. A pure function.
#pragma once

#include <optional>
#include <string>

#include <absl/time/time.h>

#include "server/executor/slurm/job_table.h"

namespace myograde::server {

// What is known of an attempt. Times are monotonic, InfiniteDuration() where it has not happened.
struct AttemptView {
  absl::Duration started;
  absl::Duration ordered = absl::InfiniteDuration();  // its order is in the spool
  absl::Duration claimed = absl::InfiniteDuration();  // seen
  std::string claim_node;
  absl::Duration heard = absl::InfiniteDuration();    // its first record
  // Its node has ended it, and says why; the job's end tells more.
  absl::Duration given_back = absl::InfiniteDuration();
  std::string given_back_why;
  absl::Duration running = absl::InfiniteDuration();  // its job was first seen to run
  absl::Duration looked = -absl::InfiniteDuration();  // its folder was last read
  JobView job;
  absl::Duration submit_trouble = absl::InfiniteDuration();  // since when sbatch fails
  std::string submit_why;
};

struct AttemptLimits {
  absl::Duration queue_wait;
  absl::Duration claim;
  absl::Duration submit = absl::Minutes(3);    // sbatch in trouble
  absl::Duration prepare = absl::Minutes(15);  // from the claim to the first record
  absl::Duration job_end = absl::Seconds(10);  // from a node's giving back to the job's end
  // From a job's end to the node's last word, in which its folder was looked at; and at most, if
  // that can't be.
  absl::Duration farewell = absl::Seconds(15);
  absl::Duration blind = absl::Minutes(10);
};

struct AttemptVerdict {
  enum class Kind { kGoesOn, kLost, kFault };
  Kind kind = Kind::kGoesOn;
  std::string why;         // one sentence
  std::string blame_node;  // whose bad end it is; "": nobody's
};

// REQUIRES: the runner's end has not arrived.
AttemptVerdict JudgeAttempt(const AttemptView& view, const AttemptLimits& limits,
                            absl::Duration now);

}  // namespace myograde::server
