// Blocks in the store, and the nodes of a cluster.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/store/context.h"
#include "server/store/damage.h"
#include "server/store/rows.h"

namespace myograde::server {

// Blocks and their states, where they ran, and the nodes that get none. A transition that the
// states do not allow is a FailedPreconditionError. `who` and `why` go into the audit rows.
class Blocks : StorePart {
 public:
  using StorePart::StorePart;

  absl::StatusOr<std::vector<BlockRow>> Of(int64_t evaluation) const;  // by first episode
  // The attempts of its blocks that have ended, by block and attempt.
  absl::StatusOr<std::vector<AttemptRow>> ListAttempts(int64_t evaluation) const;
  // By name.
  Listed<DrainedNodeRow> DrainedNodes() const;
  // pending -> running, as the given attempt (one more than before). A queued evaluation starts
  // running too.
  absl::Status Start(int64_t block, int64_t attempt, int64_t slot, int64_t deadline_ms,
                     const std::string& who);
  // running -> done. FailedPreconditionError unless every episode has its row.
  absl::Status Finish(int64_t block, int64_t attempt, const std::string& output_json,
                      const std::string& who);
  // running -> pending, for a retry. `fault`: a grader fault, which is counted.
  absl::Status Return(int64_t block, int64_t attempt, bool fault, const std::string& who,
                      const std::string& why);
  // pending or running -> failed or cancelled. `fault` as above.
  absl::Status End(int64_t block, BlockState state, bool fault, const std::string& who,
                   const std::string& why);
  // Where an attempt of a block ran and what it used, once it has ended; `ended_at` 0: now. What
  // the store has of that attempt already stays. CPU time and energy that no attempt can have used
  // are stored as the nearest that one can.
  absl::Status RecordAttempt(const AttemptRow& run);
  // A node of a cluster gets no blocks until it is admitted; the reason in force is the latest.
  // Admitting a node that is not drained changes nothing. `node` is not "".
  absl::Status SetNode(const std::string& node, bool drained, const std::string& why,
                       const std::string& who);
  absl::StatusOr<BlockRow> Find(int64_t block);

  // Why a block can't be `what`: it is in another state, or attempt.
  static absl::Status Refused(const char* what, const BlockRow& block, std::string_view step);
};

}  // namespace myograde::server
