#include "server/scheduler/scheduler.h"

#include <algorithm>

#include <absl/strings/str_cat.h>

namespace myograde::server {
namespace {

absl::Duration Doubled(absl::Duration delay, int64_t times) {
  return delay * static_cast<double>(int64_t{1} << std::min<int64_t>(times, 20));
}

}  // namespace

Scheduler::Scheduler(SchedulerLimits limits) : limits_(limits) {
  for (int slot = 0; slot < limits_.slots; ++slot) free_slots_.insert(free_slots_.end(), slot);
}

void Scheduler::Add(const EvaluationSpec& spec, absl::Duration now) {
  Evaluation& evaluation = evaluations_[spec.id];
  evaluation.spec = spec;
  evaluation.spec.blocks.clear();
  evaluation.priority = spec.priority;
  evaluation.waits_since = now;
  for (const BlockSpec& entry : spec.blocks) {
    blocks_[entry.id] = {entry, spec.id};
    evaluation.waiting.insert(entry.id);
  }
  Team& team = teams_[spec.team];
  if (team.joined == 0 && spec.priority != Priority::kRejudge) team.joined = ++joins_;
  Wait(evaluation, now + limits_.queue_wait);
}

// Takes note of which of its blocks wait.
void Scheduler::Wait(Evaluation& evaluation, absl::Duration until) {
  teams_.at(evaluation.spec.team)
      .line.Set(evaluation.priority, evaluation.spec.id, std::ssize(evaluation.waiting));
  waits_.erase({evaluation.wait_over, evaluation.spec.id});
  const bool waits = !evaluation.waiting.empty() && evaluation.priority != Priority::kRejudge;
  evaluation.wait_over = waits ? until : absl::InfiniteDuration();
  if (waits) waits_.emplace(until, evaluation.spec.id);
}

bool Scheduler::MayStart(const Team& team, Priority priority) const {
  return priority == Priority::kRejudge || team.running < limits_.team_running;
}

Scheduler::Block* Scheduler::FirstReady(const Team& team, Priority priority, absl::Duration now) {
  for (const auto& [id, waiting] : team.line.In(priority)) {
    for (const int64_t block : evaluations_.at(id).waiting) {
      Block& found = blocks_.at(block);
      if (found.not_before <= now) return &found;
    }
  }
  return nullptr;
}

std::optional<int> Scheduler::TakeSlot() {
  if (free_slots_.empty()) return std::nullopt;
  return free_slots_.extract(free_slots_.begin()).value();
}

Scheduler::Precedence Scheduler::ComputePrecedence(const Team& team,
                                                   const Evaluation& evaluation) const {
  const bool goes_on = team.turn.left > 0 && team.turn.of == evaluation.spec.id;
  Precedence turn = {team.running, goes_on ? team.turn.began : INT64_MAX, team.last_start,
                     team.joined};
  const auto submitter = parties_.find(evaluation.spec.submitter);
  if (submitter == parties_.end()) return turn;
  turn.running = std::max(turn.running, submitter->second.running);
  turn.last_start = std::max(turn.last_start, submitter->second.last_start);
  return turn;
}

std::optional<Start> Scheduler::Next(absl::Duration now) {
  if (free_slots_.empty()) return std::nullopt;
  Block* best = nullptr;
  Precedence first = {};
  for (int priority = 0; priority < kPriorities && best == nullptr; ++priority) {
    for (auto& [name, team] : teams_) {
      if (!MayStart(team, Priority(priority))) continue;
      // A submitter's running leases, or another evaluation's turn, can only move it back.
      const Precedence earliest = {team.running, team.turn.left > 0 ? team.turn.began : INT64_MAX,
                                   team.last_start, team.joined};
      if (best != nullptr && first <= earliest) continue;
      Block* block = FirstReady(team, Priority(priority), now);
      if (block == nullptr) continue;
      const Precedence turn = ComputePrecedence(team, evaluations_.at(block->evaluation));
      if (best != nullptr && first <= turn) continue;
      best = block;
      first = turn;
    }
  }
  if (best == nullptr) return std::nullopt;
  Evaluation& evaluation = evaluations_.at(best->evaluation);
  delayed_.erase({best->not_before, best->id});
  evaluation.waiting.erase(best->id);
  evaluation.running.insert(best->id);
  Wait(evaluation, now + limits_.queue_wait);
  evaluation.waits_since = now;
  best->attempt += 1;
  best->slot = *TakeSlot();
  best->started = ++starts_;
  running_.insert(best->id);
  if (evaluation.priority == Priority::kRejudge) running_rejudges_.emplace(starts_, best->id);
  if (!limits_.begins_later) {
    SetDeadlines(*best, now + limits_.heartbeat, now + evaluation.spec.lease_wall);
  }
  for (Share* share : SharesOf(evaluation)) {
    share->running += 1;
    share->last_start = starts_;
  }
  if (evaluation.priority != Priority::kRejudge) {
    const int64_t id = evaluation.spec.id;
    Turn& turn = teams_.at(evaluation.spec.team).turn;
    if (turn.left == 0 || turn.of != id) turn = {id, starts_, kLongestTurn};
    --turn.left;
  }
  return StartOf(*best);
}

int Scheduler::ReadyAboveRejudges(int most, absl::Duration now) const {
  int ready = 0;
  for (const auto& [name, team] : teams_) {
    int may_start = limits_.team_running - team.running;
    for (int priority = 0; priority < static_cast<int>(Priority::kRejudge); ++priority) {
      for (const auto& [id, waiting] : team.line.In(Priority(priority))) {
        for (const int64_t block : evaluations_.at(id).waiting) {
          if (may_start <= 0) break;
          if (blocks_.at(block).not_before > now) continue;
          --may_start;
          if (++ready == most) return ready;
        }
      }
    }
  }
  return ready;
}

std::optional<Start> Scheduler::Preempt(absl::Duration now) {
  if (!free_slots_.empty()) return std::nullopt;
  // The one that started last has the least to lose.
  if (running_rejudges_.empty()) return std::nullopt;
  Block* last = &blocks_.at(running_rejudges_.rbegin()->second);
  // Slots that are becoming free serve as many.
  const int becoming_free = static_cast<int>(preempting_.size());
  if (ReadyAboveRejudges(becoming_free + 1, now) <= becoming_free) return std::nullopt;
  Evaluation& evaluation = evaluations_.at(last->evaluation);
  preempting_.insert(last->slot);
  StopRunning(*last);
  evaluation.waiting.insert(last->id);
  Wait(evaluation, absl::InfiniteDuration());
  return StartOf(*last);
}

Scheduler::Block* Scheduler::Current(int64_t lease, int64_t attempt) {
  if (!running_.contains(lease)) return nullptr;
  Block& found = blocks_.at(lease);
  return found.attempt == attempt ? &found : nullptr;
}

void Scheduler::SetDeadlines(Block& block, absl::Duration silent_after, absl::Duration over_at) {
  deadlines_.erase({std::min(block.silent_after, block.over_at), block.id});
  block.silent_after = silent_after;
  block.over_at = over_at;
  const absl::Duration next = std::min(silent_after, over_at);
  if (next != absl::InfiniteDuration()) deadlines_.emplace(next, block.id);
}

void Scheduler::Begun(int64_t id, int64_t attempt, absl::Duration now) {
  Block* block = Current(id, attempt);
  if (block == nullptr || block->over_at != absl::InfiniteDuration()) return;
  SetDeadlines(*block, now + limits_.heartbeat,
               now + evaluations_.at(block->evaluation).spec.lease_wall);
}

void Scheduler::Heartbeat(int64_t id, int64_t attempt, absl::Duration now) {
  Block* block = Current(id, attempt);
  if (block != nullptr && block->over_at != absl::InfiniteDuration()) {
    SetDeadlines(*block, now + limits_.heartbeat, block->over_at);
  }
}

// The slot stays taken.
void Scheduler::StopRunning(Block& block) {
  Evaluation& evaluation = evaluations_.at(block.evaluation);
  running_.erase(block.id);
  running_rejudges_.erase({block.started, block.id});
  SetDeadlines(block, absl::InfiniteDuration(), absl::InfiniteDuration());
  evaluation.running.erase(block.id);
  for (Share* share : SharesOf(evaluation)) share->running -= 1;
}

std::vector<Scheduler::Share*> Scheduler::SharesOf(const Evaluation& evaluation) {
  if (evaluation.spec.priority == Priority::kRejudge) return {};
  std::vector<Share*> shares = {&teams_.at(evaluation.spec.team)};
  if (!evaluation.spec.submitter.empty()) shares.push_back(&parties_[evaluation.spec.submitter]);
  return shares;
}

void Scheduler::Remove(int64_t id) {
  const auto it = evaluations_.find(id);
  Evaluation& evaluation = it->second;
  evaluation.waiting.clear();
  Wait(evaluation, absl::InfiniteDuration());
  evaluations_.erase(it);
}

Decision Scheduler::Finished(int64_t id, int64_t attempt, absl::Duration now) {
  Block* block = Current(id, attempt);
  if (block == nullptr) return {};
  Decision decision{.kind = Decision::Kind::kEvaluationRuns, .evaluation = block->evaluation};
  StopRunning(*block);
  blocks_.erase(id);
  Evaluation& evaluation = evaluations_.at(decision.evaluation);
  if (evaluation.waiting.empty() && evaluation.running.empty()) {
    Remove(decision.evaluation);
    decision.kind = Decision::Kind::kEvaluationEnds;
  } else {
    Wait(evaluation, now + limits_.queue_wait);
  }
  return decision;
}

Decision Scheduler::Faulted(int64_t id, int64_t attempt, absl::Duration now, bool permanent) {
  Block* block = Current(id, attempt);
  if (block == nullptr) return {};
  const int64_t owner = block->evaluation;
  block->faults += 1;
  StopRunning(*block);
  if (!permanent && block->faults <= limits_.max_retries) {
    WaitAgain(*block, Doubled(limits_.retry_delay, block->faults - 1), now);
    return {.kind = Decision::Kind::kRetry, .evaluation = owner, .fault = true};
  }
  blocks_.erase(id);
  Decision decision = Cancel(owner);
  decision.kind = Decision::Kind::kGiveUp;
  decision.fault = true;
  return decision;
}

Decision Scheduler::Returned(int64_t id, int64_t attempt, absl::Duration now) {
  Block* block = Current(id, attempt);
  if (block == nullptr) return {};
  if (++block->returns > limits_.max_returns) return Faulted(id, attempt, now);
  StopRunning(*block);
  WaitAgain(*block, std::min(Doubled(limits_.retry_delay, block->returns - 1), kLongestReturn),
            now);
  return {.kind = Decision::Kind::kRetry, .evaluation = block->evaluation};
}

// REQUIRES: it does not run.
void Scheduler::WaitAgain(Block& block, absl::Duration delay, absl::Duration now) {
  Evaluation& evaluation = evaluations_.at(block.evaluation);
  block.not_before = now + delay;
  delayed_.emplace(block.not_before, block.id);
  evaluation.waiting.insert(block.id);
  Wait(evaluation, now + limits_.queue_wait);
}

Decision Scheduler::Cancel(int64_t id) {
  const auto it = evaluations_.find(id);
  if (it == evaluations_.end()) return {};
  const Evaluation& evaluation = it->second;
  Decision decision{.kind = Decision::Kind::kEvaluationEnds, .evaluation = id};
  decision.pending.assign(evaluation.waiting.begin(), evaluation.waiting.end());
  decision.running.assign(evaluation.running.begin(), evaluation.running.end());
  for (const int64_t lease : decision.running) StopRunning(blocks_.at(lease));
  for (const int64_t lease : decision.running) blocks_.erase(lease);
  for (const int64_t block : decision.pending) {
    delayed_.erase({blocks_.at(block).not_before, block});
    blocks_.erase(block);
  }
  Remove(id);
  return decision;
}

void Scheduler::MoveTeam(const std::string& from, const std::string& to) {
  const auto old = teams_.find(from);
  if (old == teams_.end() || from == to) return;
  Team& team = teams_[to];
  const int64_t joined = old->second.joined;
  if (team.joined == 0 || (joined != 0 && joined < team.joined)) team.joined = joined;
  if (team.turn.left == 0) team.turn = old->second.turn;
  team.running += old->second.running;
  team.last_start = std::max(team.last_start, old->second.last_start);
  for (auto& [id, evaluation] : evaluations_) {
    if (evaluation.spec.team != from) continue;
    evaluation.spec.team = to;
    Wait(evaluation, evaluation.wait_over);
  }
  teams_.erase(old);
}

std::vector<std::string> Scheduler::Teams() const {
  std::vector<std::string> names;
  for (const auto& [name, team] : teams_) names.push_back(name);
  return names;
}

std::vector<Overdue> Scheduler::OverdueAt(absl::Duration now) const {
  std::vector<Overdue> overdue;
  for (const auto& [deadline, id] : deadlines_) {
    if (deadline > now) break;
    const Block& block = blocks_.at(id);
    if (block.over_at <= now) {
      overdue.push_back({id, block.attempt, /*silent=*/false,
                         "the runner kept the lease beyond its wall-clock cap"});
    } else {
      overdue.push_back({id, block.attempt, /*silent=*/true,
                         absl::StrCat("the lease was not renewed: its runner was silent for ",
                                      absl::FormatDuration(limits_.heartbeat))});
    }
  }
  return overdue;
}

std::vector<int64_t> Scheduler::Escalate(absl::Duration now) {
  std::vector<int64_t> late;
  while (!waits_.empty() && waits_.begin()->first <= now) {
    const int64_t id = waits_.begin()->second;
    Evaluation& evaluation = evaluations_.at(id);
    teams_.at(evaluation.spec.team).line.Set(evaluation.priority, id, 0);
    evaluation.priority = Priority::kOverdue;
    Wait(evaluation, now + limits_.queue_wait);
    late.push_back(id);
  }
  return late;
}

std::optional<absl::Duration> Scheduler::NextDeadline(absl::Duration now) const {
  absl::Duration next = absl::InfiniteDuration();
  if (!deadlines_.empty()) next = deadlines_.begin()->first;
  const auto delayed = delayed_.upper_bound({now, INT64_MAX});
  if (delayed != delayed_.end()) next = std::min(next, delayed->first);
  if (!waits_.empty()) next = std::min(next, waits_.begin()->first);
  if (next == absl::InfiniteDuration()) return std::nullopt;
  return next;
}

}  // namespace myograde::server
