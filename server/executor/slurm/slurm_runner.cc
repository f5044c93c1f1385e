#include "server/executor/slurm/slurm_runner.h"

#include <algorithm>
#include <utility>

namespace myograde::server {

absl::StatusOr<std::vector<LeaseRecord>> SlurmRunner::Read() {
  const MutexLock lock(executor_.mutex_);
  if (!attempt_->broken.empty()) return absl::DataLossError(attempt_->broken);
  return std::exchange(attempt_->records, {});
}

bool SlurmRunner::finished() {
  const MutexLock lock(executor_.mutex_);
  return attempt_->end.has_value() && attempt_->lost.empty() && attempt_->records.empty();
}

bool SlurmRunner::dead() { return executor_.IsGone(*attempt_); }

bool SlurmRunner::begun() const {
  const MutexLock lock(executor_.mutex_);
  return attempt_->view.heard != absl::InfiniteDuration() || attempt_->end.has_value();
}

std::string SlurmRunner::lost() const {
  const MutexLock lock(executor_.mutex_);
  return attempt_->lost;
}

RunnerSite SlurmRunner::site() const {
  const MutexLock lock(executor_.mutex_);
  RunnerSite site;
  const AttemptView& view = attempt_->view;
  site.node = view.claim_node.empty() ? view.job.node : view.claim_node;
  site.job = view.job.id;
  for (const std::optional<NodeEnd>* end : {&attempt_->end, &attempt_->used}) {
    if (!end->has_value()) continue;
    site.cpu_s = std::max(site.cpu_s, (*end)->cpu_s);
    if ((*end)->energy_j.has_value()) site.energy_j = (*end)->energy_j;
  }
  return site;
}

int SlurmRunner::wait_status() const {
  const MutexLock lock(executor_.mutex_);
  return attempt_->end.has_value() ? attempt_->end->wait_status : 0;
}

std::string SlurmRunner::stderr_tail() const {
  const MutexLock lock(executor_.mutex_);
  return attempt_->end.has_value() ? attempt_->end->stderr_tail : "";
}

}  // namespace myograde::server
