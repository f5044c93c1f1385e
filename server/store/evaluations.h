// Evaluations in the store.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/store/context.h"
#include "server/store/damage.h"
#include "server/store/rows.h"
#include "server/store/submissions.h"

namespace myograde::server {

// Evaluations and how they end. `who` and `why` go into the audit rows.
class Evaluations : StorePart {
 public:
  using StorePart::StorePart;

  absl::StatusOr<EvaluationRow> Find(int64_t id) const;
  // A submission's evaluations, the original first. Never empty.
  absl::StatusOr<std::vector<EvaluationRow>> Of(int64_t submission) const;
  absl::StatusOr<EvaluationRow> Original(int64_t submission) const;
  // Every evaluation that has not ended, oldest first.
  Listed<EvaluationRow> Unfinished() const;
  absl::StatusOr<std::vector<TransitionRow>> Transitions(const std::string& entity,
                                                         int64_t id) const;
  absl::StatusOr<std::string> TeamOf(int64_t id) const;
  // Evaluations that ended as done after `after_ms`: the last `limit` of them, oldest first.
  std::vector<int64_t> DoneSince(int64_t after_ms, int64_t limit) const;
  // When the last one ended, in ms since 1970; 0: none has.
  int64_t LastEnd() const;
  // Evaluations that are done: all, or those without a standing.
  std::vector<int64_t> Done(bool without_standing) const;
  // By submission and repetition.
  absl::StatusOr<std::vector<EvaluationRow>> OfRejudge(int64_t rejudge) const;
  // The builds that evaluations are of, as stored; "" for one that is missing.
  std::vector<std::string> ListGraders(const std::vector<int64_t>& evaluations) const;
  // Adds an audit row for an evaluation without changing its state.
  absl::Status Note(int64_t evaluation, const std::string& who, const std::string& why);
  // queued or running -> a final state. FailedPreconditionError while any of its blocks has not
  // ended.
  absl::Status End(int64_t evaluation, EvaluationState state, const std::string& reason,
                   const std::string& results_hash, const std::string& who);
  // The same, and cancels its blocks that have not ended.
  absl::Status EndWithBlocks(int64_t evaluation, EvaluationState state, const std::string& why,
                             const std::string& who);
  // Ends an evaluation with unreadable rows as grader_error, as far as they can be written: values
  // of a wrong type become 0 and "". An error: it stays as it is.
  absl::Status EndUnreadable(int64_t evaluation, const std::string& why, const std::string& who);
  // The evaluations that a cancel of the submission ends: those of its original one and, if
  // `reruns`, its reruns that have not ended. Rejudges end by DropRejudge alone.
  std::vector<int64_t> OpenOf(int64_t submission, bool reruns);
  // Queued, with its blocks. Of `added` its submission, kind and build are used, and all of a
  // rejudge's; config and seeds "" are the submission's.
  absl::StatusOr<Accepted> Add(const EvaluationRow& added, const EpisodeBlocks& blocks,
                               const std::string& who);

  // Adds to the journal how it ended; practice and reruns have no act.
  void AppendGraded(int64_t evaluation, const std::string& who);
};

}  // namespace myograde::server
