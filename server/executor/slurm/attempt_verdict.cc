#include "server/executor/slurm/attempt_verdict.h"

#include <algorithm>

#include <absl/strings/str_cat.h>

namespace myograde::server {
namespace {

using Kind = AttemptVerdict::Kind;

std::string JobOf(const AttemptView& view) {
  const std::string& node = view.claim_node.empty() ? view.job.node : view.claim_node;
  return absl::StrCat("job ", view.job.id, node.empty() ? "" : " on " + node);
}

std::string Seconds(absl::Duration time) {
  return absl::StrCat(absl::ToInt64Seconds(time), " s");
}

AttemptVerdict JudgeOver(const AttemptView& view, const AttemptLimits& limits,
                         absl::Duration now) {
  const absl::Duration seen = std::max(view.looked - view.job.over_since, absl::ZeroDuration());
  if (seen < limits.farewell && now - view.job.over_since < limits.blind) return {};
  const bool claimed = view.claimed != absl::InfiniteDuration();
  std::string why =
      absl::StrCat(JobOf(view), " ",
                   view.job.missing ? "is not in the cluster's queue any more"
                                    : HowItEnded(view.job.state),
                   claimed ? " before its lease had ended" : " before it took its lease");
  if (view.job.state == JobState::kTimeLimit || view.job.state == JobState::kMemory) {
    return {Kind::kFault, why, ""};
  }
  if (const std::string reason = WhyItFailed(view.job.wait_status);
      view.job.state == JobState::kFailed && !view.job.missing && !reason.empty()) {
    absl::StrAppend(&why, ": ", reason);
  }
  // A program that never took its lease is not there, or can't run.
  const bool blamed = !claimed && !view.job.missing && view.job.state == JobState::kFailed;
  return {Kind::kLost, why, blamed ? view.job.node : ""};
}

AttemptVerdict JudgeUnclaimed(const AttemptView& view, const AttemptLimits& limits,
                              absl::Duration now) {
  if (view.job.id.empty() && now - view.submit_trouble >= limits.submit) {
    return {Kind::kLost, absl::StrCat("no job could be submitted: ", view.submit_why), ""};
  }
  if (view.job.state == JobState::kRunning && now - view.running >= limits.claim) {
    return {Kind::kLost,
            absl::StrCat(JobOf(view), " runs since ", Seconds(now - view.running),
                         " and has not taken its lease"),
            view.job.node};
  }
  // Trouble with sbatch has a limit of its own.
  if (view.job.state != JobState::kRunning && now - view.started >= limits.queue_wait) {
    return {Kind::kLost,
            absl::StrCat(view.job.id.empty() ? "its job" : JobOf(view), " had not begun after ",
                         Seconds(now - view.started),
                         view.job.reason.empty() || view.job.reason == "None"
                             ? ""
                             : absl::StrCat(" (", view.job.reason, ")")),
            ""};
  }
  return {};
}

// Told to end, a node can't know whether by a limit of the lease's or by somebody's wish.
AttemptVerdict JudgeGivenBack(const AttemptView& view, const AttemptLimits& limits,
                              absl::Duration now) {
  const JobView& job = view.job;
  const bool over = job.over_since != absl::InfiniteDuration();
  const bool requeued = job.state == JobState::kWaiting && job.seen > view.given_back;
  if (!over && !requeued && now - view.given_back < limits.job_end) return {};
  if (over && (job.state == JobState::kTimeLimit || job.state == JobState::kMemory)) {
    return {Kind::kFault,
            absl::StrCat(JobOf(view), " ", HowItEnded(job.state), " before its lease had ended"),
            ""};
  }
  // A node that ends by itself and never came to play is no good, whatever it says.
  const bool blamed =
      over && job.state == JobState::kDone && view.heard == absl::InfiniteDuration();
  return {Kind::kLost,
          absl::StrCat("the node ", view.claim_node, " gave it back: ", view.given_back_why),
          blamed ? view.claim_node : ""};
}

}  // namespace

AttemptVerdict JudgeAttempt(const AttemptView& view, const AttemptLimits& limits,
                            absl::Duration now) {
  if (view.given_back != absl::InfiniteDuration()) return JudgeGivenBack(view, limits, now);
  if (view.job.over_since != absl::InfiniteDuration()) return JudgeOver(view, limits, now);
  if (view.claimed == absl::InfiniteDuration()) return JudgeUnclaimed(view, limits, now);
  // Whatever played it was stopped, and must not go on under a claim that is taken.
  if (view.job.state == JobState::kWaiting && view.job.seen > view.claimed) {
    return {Kind::kLost, absl::StrCat(JobOf(view), " was put back into the cluster's queue"), ""};
  }
  if (view.heard == absl::InfiniteDuration() && now - view.claimed >= limits.prepare) {
    return {Kind::kLost,
            absl::StrCat(JobOf(view), " took its lease ", Seconds(now - view.claimed),
                         " ago and has not begun to play"),
            view.claim_node};
  }
  return {};
}

}  // namespace myograde::server
