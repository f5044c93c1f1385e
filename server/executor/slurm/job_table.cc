#include "server/executor/slurm/job_table.h"

#include <algorithm>
#include <utility>

namespace myograde::server {

void JobTable::Add(const std::string& name, int64_t evaluation, const JobNeeds& needs,
                   absl::Duration now) {
  Attempt attempt;
  attempt.evaluation = evaluation;
  attempt.needs = needs;
  attempt.added = now;
  attempt.job.seen = -absl::InfiniteDuration();
  attempt.job.over_since = absl::InfiniteDuration();
  attempts_[name] = std::move(attempt);
}

void JobTable::Remove(const std::string& name, bool leaves, absl::Duration now) {
  const auto it = attempts_.find(name);
  if (it == attempts_.end() || !it->second.wanted) return;
  Attempt& attempt = it->second;
  attempt.wanted = false;
  attempt.removed = now;
  attempt.cancel_at = now + (leaves ? kLeave : absl::ZeroDuration());
  if (leaves || attempt.job.id.empty() || IsOver(attempt.job.state)) return;
  for (const auto& [array, names] : arrays_) {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found != names.end()) strays_.push_back({.array = array, .task = found - names.begin()});
  }
}

bool JobTable::gone(const std::string& name, absl::Duration now) const {
  const auto it = attempts_.find(name);
  if (it == attempts_.end()) return true;
  const Attempt& attempt = it->second;
  if (attempt.wanted) return false;
  return attempt.ready || IsOver(attempt.job.state) || now - attempt.removed >= kForget;
}

void JobTable::Forget(const std::string& name) {
  attempts_.erase(name);
  std::erase_if(arrays_, [&](const auto& array) {
    return std::none_of(array.second.begin(), array.second.end(),
                        [&](const std::string& task) { return attempts_.contains(task); });
  });
}

absl::Duration JobTable::next_at() const {
  absl::Duration first = absl::InfiniteDuration();
  for (const auto& [name, attempt] : attempts_) {
    if (attempt.ready && attempt.wanted) first = std::min(first, attempt.added + kGather);
  }
  return std::max(first, retry_at_);
}

// The evaluation of the attempt that waits longest, with as many of its others as fit in.
std::optional<JobTable::Batch> JobTable::Next(absl::Duration now) {
  if (now < retry_at_) return std::nullopt;
  const Attempt* oldest = nullptr;
  for (const auto& [name, attempt] : attempts_) {
    if (!attempt.ready || !attempt.wanted) continue;
    if (oldest == nullptr || attempt.added < oldest->added) oldest = &attempt;
  }
  if (oldest == nullptr || now < oldest->added + kGather) return std::nullopt;
  Batch batch{{}, oldest->needs};
  const int64_t evaluation = oldest->evaluation;
  for (auto& [name, attempt] : attempts_) {
    if (batch.names.size() == array_size_) break;
    if (!attempt.ready || !attempt.wanted || attempt.evaluation != evaluation ||
        attempt.needs != batch.needs) {
      continue;
    }
    attempt.ready = false;
    batch.names.push_back(name);
  }
  asking_ = true;
  return batch;
}

void JobTable::Place(const std::vector<std::string>& names, int64_t array) {
  arrays_[array] = names;
  for (size_t task = 0; task < names.size(); ++task) {
    const auto it = attempts_.find(names[task]);
    if (it == attempts_.end()) continue;
    const SlurmJob job{.array = array, .task = static_cast<int64_t>(task)};
    it->second.job.id = job.id();
    if (!it->second.wanted) strays_.push_back(job);
  }
}

void JobTable::Accepted(const Batch& batch, int64_t array) {
  NoTrouble();
  Place(batch.names, array);
}

void JobTable::NoTrouble() {
  asking_ = false;
  trouble_.clear();
  retry_ = kRetry;
  retry_at_ = -absl::InfiniteDuration();
}

std::string JobTable::trouble() const {
  const bool tried_again =
      asking_ || !lost_.empty() || std::any_of(attempts_.begin(), attempts_.end(), [](const auto& entry) {
        return entry.second.ready && entry.second.wanted;
      });
  return tried_again ? trouble_ : "";
}

void JobTable::Trouble(const std::string& why, absl::Duration now) {
  asking_ = false;
  if (trouble_.empty()) trouble_since_ = now;
  trouble_ = why;
  retry_at_ = now + retry_;
  retry_ = std::min(2 * retry_, kMostRetry);
}

void JobTable::Refused(const Batch& batch, const std::string& why, absl::Duration now) {
  Trouble(why, now);
  for (const std::string& name : batch.names) {
    const auto it = attempts_.find(name);
    if (it != attempts_.end()) it->second.ready = true;
  }
}

void JobTable::Lost(const Batch& batch, const std::string& comment, const std::string& why,
                    absl::Duration now) {
  Trouble(why, now);
  lost_[comment] = {batch.names, now};
}

// Finds out about batches whose sbatch got no answer.
void JobTable::PlaceLost(const std::vector<SlurmJob>& jobs, absl::Duration asked) {
  if (lost_.empty()) return;
  for (const SlurmJob& job : jobs) {
    const auto it = lost_.find(job.batch);
    if (it == lost_.end() || arrays_.contains(job.array)) continue;
    // The cluster did take it; the one that is being asked about now tells the rest.
    if (!asking_) NoTrouble();
    Place(it->second.names, job.array);
    lost_.erase(it);
  }
  for (auto it = lost_.begin(); it != lost_.end();) {
    if (asked < it->second.at) {
      ++it;
      continue;
    }
    // Should the cluster take it later after all, its tasks are strays.
    for (const std::string& name : it->second.names) {
      const auto attempt = attempts_.find(name);
      if (attempt != attempts_.end()) attempt->second.ready = true;
    }
    it = lost_.erase(it);
  }
}

JobTable::Attempt* JobTable::AttemptOf(const SlurmJob& job) {
  const auto array = arrays_.find(job.array);
  if (array == arrays_.end() || job.task < 0 || job.task >= std::ssize(array->second)) {
    return nullptr;
  }
  const auto it = attempts_.find(array->second[static_cast<size_t>(job.task)]);
  return it == attempts_.end() || it->second.job.id != job.id() ? nullptr : &it->second;
}

bool JobTable::IsStray(const SlurmJob& job, absl::Duration asked) {
  if (IsOver(job.state) || job.state == JobState::kEnding) return false;
  const Attempt* attempt = AttemptOf(job);
  return attempt == nullptr || (!attempt->wanted && asked >= attempt->cancel_at);
}

std::vector<SlurmJob> JobTable::See(const std::vector<SlurmJob>& jobs, absl::Duration asked) {
  PlaceLost(jobs, asked);
  std::vector<SlurmJob> strays;
  for (const SlurmJob& job : jobs) {
    Attempt* attempt = AttemptOf(job);
    if (IsStray(job, asked)) strays.push_back(job);
    if (attempt == nullptr) continue;
    JobView& view = attempt->job;
    attempt->missed = 0;
    view.missing = false;
    view.state = job.state;
    if (!job.node.empty()) view.node = job.node;
    view.reason = job.reason;
    view.wait_status = job.wait_status;
    view.seen = asked;
    view.over_since =
        IsOver(job.state) ? std::min(view.over_since, asked) : absl::InfiniteDuration();
  }
  NotShown(asked);
  return strays;
}

void JobTable::NotShown(absl::Duration asked) {
  for (auto& [name, attempt] : attempts_) {
    JobView& view = attempt.job;
    if (view.id.empty() || view.seen == asked || ++attempt.missed < kMissingAnswers) continue;
    if (view.over_since != absl::InfiniteDuration()) continue;
    view.state = JobState::kFailed;
    view.missing = true;
    view.over_since = asked;
  }
}

std::vector<SlurmJob> JobTable::TakeStrays() { return std::exchange(strays_, {}); }

const JobView* JobTable::Find(const std::string& name) const {
  const auto it = attempts_.find(name);
  return it == attempts_.end() ? nullptr : &it->second.job;
}

}  // namespace myograde::server
