#include "server/scheduler/scheduler.h"

#include <algorithm>
#include <tuple>

#include <absl/strings/str_cat.h>

namespace myograde::server {

Scheduler::Scheduler(SchedulerLimits limits) : limits_(limits) {}

void Scheduler::Add(const EvaluationSpec& spec) {
  Evaluation& evaluation = evaluations_[spec.id];
  evaluation.spec = spec;
  for (const LeaseSpec& entry : spec.leases) {
    Lease& lease = leases_[entry.id];
    lease.id = entry.id;
    lease.evaluation = spec.id;
    lease.attempt = entry.attempt;
    lease.faults = entry.faults;
    evaluation.open.insert(entry.id);
  }
  auto [team, is_new] = teams_.try_emplace(spec.team);
  if (is_new) team->second.joined = ++joins_;
  team->second.evaluations.emplace(static_cast<int>(spec.priority), spec.id);
}

Scheduler::Lease* Scheduler::FirstPending(const Evaluation& evaluation, absl::Duration now) {
  for (const LeaseSpec& entry : evaluation.spec.leases) {
    const auto it = leases_.find(entry.id);
    if (it == leases_.end() || it->second.running || it->second.not_before > now) continue;
    return &it->second;
  }
  return nullptr;
}

Scheduler::Lease* Scheduler::FirstPending(const Team& team, absl::Duration now) {
  for (const auto& [priority, id] : team.evaluations) {
    if (Lease* lease = FirstPending(evaluations_.at(id), now); lease != nullptr) return lease;
  }
  return nullptr;
}

std::optional<Start> Scheduler::Next(absl::Duration now) {
  if (running() >= limits_.slots) return std::nullopt;
  Team* best_team = nullptr;
  Lease* best = nullptr;
  const auto turn = [](const Team& team) {
    return std::tuple(team.running, team.last_start, team.joined);
  };
  for (auto& [name, team] : teams_) {
    if (best_team != nullptr && turn(*best_team) <= turn(team)) continue;
    if (Lease* lease = FirstPending(team, now); lease != nullptr) {
      best_team = &team;
      best = lease;
    }
  }
  if (best == nullptr) return std::nullopt;
  const Evaluation& evaluation = evaluations_.at(best->evaluation);
  best->running = true;
  best->attempt += 1;
  best->slot = 0;
  while (running_slots_.contains(best->slot)) ++best->slot;
  running_slots_.insert(best->slot);
  best->silent_after = now + limits_.heartbeat;
  best->over_at = now + evaluation.spec.lease_wall;
  best_team->running += 1;
  best_team->last_start = ++starts_;
  return Start{best->evaluation, best->id, best->attempt, best->slot, evaluation.spec.lease_wall};
}

Scheduler::Lease* Scheduler::Current(int64_t lease, int64_t attempt) {
  const auto it = leases_.find(lease);
  if (it == leases_.end() || !it->second.running || it->second.attempt != attempt) return nullptr;
  return &it->second;
}

bool Scheduler::IsCurrent(int64_t lease, int64_t attempt) const {
  const auto it = leases_.find(lease);
  return it != leases_.end() && it->second.running && it->second.attempt == attempt;
}

void Scheduler::Heartbeat(int64_t lease, int64_t attempt, absl::Duration now) {
  if (Lease* current = Current(lease, attempt)) current->silent_after = now + limits_.heartbeat;
}

void Scheduler::Release(Lease& lease) {
  if (!lease.running) return;
  lease.running = false;
  running_slots_.erase(lease.slot);
  lease.slot = -1;
  teams_.at(evaluations_.at(lease.evaluation).spec.team).running -= 1;
}

void Scheduler::Remove(int64_t id) {
  const auto it = evaluations_.find(id);
  Team& team = teams_.at(it->second.spec.team);
  team.evaluations.erase({static_cast<int>(it->second.spec.priority), id});
  evaluations_.erase(it);
}

Verdict Scheduler::Finished(int64_t id, int64_t attempt) {
  Lease* lease = Current(id, attempt);
  if (lease == nullptr) return {};
  Verdict verdict{.kind = Verdict::Kind::kEvaluationRuns, .evaluation = lease->evaluation};
  Release(*lease);
  Evaluation& evaluation = evaluations_.at(verdict.evaluation);
  evaluation.open.erase(id);
  leases_.erase(id);
  if (evaluation.open.empty()) {
    Remove(verdict.evaluation);
    verdict.kind = Verdict::Kind::kEvaluationEnds;
  }
  return verdict;
}

Verdict Scheduler::Faulted(int64_t id, int64_t attempt, absl::Duration now) {
  Lease* lease = Current(id, attempt);
  if (lease == nullptr) return {};
  lease->faults += 1;
  if (lease->faults <= limits_.max_replays) {
    Release(*lease);
    const int64_t doublings = std::min<int64_t>(lease->faults - 1, 20);
    lease->not_before = now + limits_.replay_delay * static_cast<double>(int64_t{1} << doublings);
    return {.kind = Verdict::Kind::kReplay, .evaluation = lease->evaluation};
  }
  const int64_t evaluation = lease->evaluation;
  Release(*lease);
  evaluations_.at(evaluation).open.erase(id);
  leases_.erase(id);
  Verdict verdict = Cancel(evaluation);
  verdict.kind = Verdict::Kind::kGiveUp;
  return verdict;
}

Verdict Scheduler::Cancel(int64_t id) {
  const auto it = evaluations_.find(id);
  if (it == evaluations_.end()) return {};
  Verdict verdict{.kind = Verdict::Kind::kEvaluationEnds, .evaluation = id};
  for (const int64_t open : it->second.open) {
    Lease& lease = leases_.at(open);
    (lease.running ? verdict.running : verdict.pending).push_back(open);
    Release(lease);
    leases_.erase(open);
  }
  Remove(id);
  return verdict;
}

std::vector<Overdue> Scheduler::OverdueAt(absl::Duration now) const {
  std::vector<Overdue> overdue;
  for (const auto& [id, lease] : leases_) {
    if (!lease.running) continue;
    if (lease.over_at <= now) {
      overdue.push_back({id, lease.attempt, "the runner kept the lease beyond its wall-clock cap"});
    } else if (lease.silent_after <= now) {
      overdue.push_back({id, lease.attempt,
                         absl::StrCat("the runner was silent for ",
                                      absl::FormatDuration(limits_.heartbeat))});
    }
  }
  return overdue;
}

std::optional<absl::Duration> Scheduler::NextDeadline(absl::Duration now) const {
  absl::Duration next = absl::InfiniteDuration();
  for (const auto& [id, lease] : leases_) {
    if (lease.running) {
      next = std::min({next, lease.silent_after, lease.over_at});
    } else if (lease.not_before > now) {
      next = std::min(next, lease.not_before);
    }
  }
  if (next == absl::InfiniteDuration()) return std::nullopt;
  return next;
}

int64_t Scheduler::pending() const { return static_cast<int64_t>(leases_.size()) - running(); }

// The order in which evaluations that have not begun would get their first slot, were each
// turn one evaluation long: teams by turn, each with its next evaluation, round after round.
std::vector<int64_t> Scheduler::EvaluationsInLine() const {
  std::vector<std::tuple<int64_t, int, int64_t, int64_t, int64_t>> keys;
  for (const auto& [name, team] : teams_) {
    int64_t round = 0;
    for (const auto& [priority, id] : team.evaluations) {
      keys.emplace_back(round++, team.running, team.last_start, team.joined, id);
    }
  }
  std::sort(keys.begin(), keys.end());
  std::vector<int64_t> line;
  for (const auto& key : keys) line.push_back(std::get<4>(key));
  return line;
}

std::optional<QueuePlace> Scheduler::PlaceOf(int64_t id) const {
  if (!evaluations_.contains(id)) return std::nullopt;
  QueuePlace place{.position = 1};
  for (const int64_t other : EvaluationsInLine()) {
    if (other == id) break;
    int64_t waiting = 0;
    for (const int64_t lease : evaluations_.at(other).open) {
      if (!leases_.at(lease).running) ++waiting;
    }
    if (waiting == 0) continue;
    place.position += 1;
    place.leases_ahead += waiting;
  }
  return place;
}

std::string Scheduler::WhyWaiting(int64_t id, absl::Duration now) const {
  const auto it = evaluations_.find(id);
  if (it == evaluations_.end()) return "";
  int64_t waiting = 0;
  absl::Duration delay = absl::InfiniteDuration();
  for (const int64_t open : it->second.open) {
    const Lease& lease = leases_.at(open);
    if (lease.running) continue;
    ++waiting;
    delay = std::min(delay, lease.not_before - now);
  }
  if (waiting == 0) return "";
  const std::string leases = waiting == 1 ? "1 lease waits" : absl::StrCat(waiting, " leases wait");
  if (delay > absl::ZeroDuration()) {
    return absl::StrCat(leases, " to be played again after a fault of the grader, in ",
                        absl::FormatDuration(absl::Ceil(delay, absl::Seconds(1))));
  }
  const QueuePlace place = *PlaceOf(id);
  return absl::StrCat(leases, " for a slot: ", running(), " of ", limits_.slots, " are taken, ",
                      place.leases_ahead, " leases of others are ahead");
}

}  // namespace myograde::server
