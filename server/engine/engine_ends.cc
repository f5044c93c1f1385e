// How leases end, and what follows.
#include <algorithm>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/base/log_line.h"
#include "server/engine/engine_core.h"

namespace myograde::server {
namespace {

// A cancel is answered by then, however slowly a process dies.
constexpr absl::Duration kCancelAnswer = absl::Milliseconds(950);
// For a runner that stays until everything it started is dead; after that, survivors keep the slot
// closed by themselves.
constexpr absl::Duration kLongestStay = absl::Minutes(10);
// Kinds of faults, as they are counted.
constexpr char kReportFault[] = "report";
constexpr char kOverdueFault[] = "overdue";
// How often closed slots are checked.
constexpr absl::Duration kSlotCheckInterval = absl::Milliseconds(500);
// The weight of the latest lease in the running mean of durations.
constexpr double kNewest = 0.2;

nlohmann::json OutputJson(const LeaseEndRecord& end) {
  return {{"stdout_tail", end.stdout_tail},
          {"stderr_tail", end.stderr_tail},
          {"stdout_truncated", end.stdout_truncated},
          {"stderr_truncated", end.stderr_truncated},
          {"policy_cpu_s", end.policy_cpu_s},
          {"simulator_cpu_s", end.simulator_cpu_s},
          {"wall_s", end.wall_s},
          {"peak_memory_bytes", end.peak_memory_bytes}};
}

}  // namespace

LogFields EngineCore::FieldsOf(const LeaseRun& run) {
  return {.evaluation = run.context->evaluation.id,
          .submission = run.context->submission.id,
          .lease = run.lease,
          .attempt = run.attempt,
          .team = run.context->submission.team};
}

void EngineCore::WriteReturn(const LeaseRun& run, bool fault, const std::string& why) {
  AddToJournal(run.context->evaluation.id, [lease = run.lease, attempt = run.attempt, fault, why,
                                            who = owner_](Transaction& writer) {
    return writer.blocks.Return(lease, attempt, fault, who, why);
  });
}

// Runners that ended by themselves, and those whose records show a fault.
void EngineCore::ReapRunners() {
  const absl::Duration now = clock_.Monotonic();
  for (auto it = running_.begin(); it != running_.end();) {
    LeaseRun& run = it->second;
    if (!run.runner->finished()) {
      ++it;
      continue;
    }
    Listen(run);  // what arrived between the last read and the exit
    FreeSlot(run.slot);
    OnRunnerEnd(run);
    executor_.CleanUp(run.work_dir);
    it = running_.erase(it);
  }
  // Giving up one reclaims others.
  int64_t lease = 0;
  for (auto it = running_.begin(); it != running_.end(); it = running_.upper_bound(lease)) {
    lease = it->first;
    LeaseRun& run = it->second;
    if (run.report.faulty()) {
      Fault(run, kReportFault, run.report.fault());
      Reclaim(lease);
    } else if (!run.runner->lost().empty()) {
      Return(run, run.begun ? "lost" : "not begun", run.runner->lost());
      Reclaim(lease);
    } else if (run.report.lingers(now)) {
      // The lease is complete; whatever keeps the runner alive concerns only its slot.
      spdlog::warn("lease {} has ended, but its runner stays on slot {}: one of its processes "
                   "can't be killed yet", lease, run.slot);
      OnRunnerEnd(run);
      Reclaim(lease, /*ask=*/false);
    }
  }
}

void EngineCore::ReclaimOverdue(absl::Duration now) {
  std::vector<Overdue> overdue;
  {
    const MutexLock lock(mutex_);
    overdue = scheduler_.OverdueAt(now);
  }
  for (const Overdue& late : overdue) {
    const auto it = running_.find(late.lease);
    if (it == running_.end()) continue;
    // A runner that has sent its end record is done, even if its process is still alive.
    if (it->second.report.end().has_value()) {
      OnRunnerEnd(it->second);
    } else if (late.silent && executor_.remote()) {
      Return(it->second, "silent", late.why);
    } else {
      Fault(it->second, kOverdueFault, late.why);
    }
    Reclaim(late.lease);
  }
}

void EngineCore::FreeSlot(int slot) {
  if (CloseSlots(slot, 1)) return;
  const MutexLock lock(mutex_);
  scheduler_.Free(slot);
}

// At the start: processes that an earlier daemon's leases left behind, if its runners were killed
// before they could reap them.
bool EngineCore::CloseSlots(int first, int count) {
  const std::map<int, std::string> found = executor_.FindProcesses(first, count);
  const MutexLock lock(mutex_);
  for (const auto& [slot, left] : found) {
    spdlog::warn("slot {} is closed until {} is gone", slot, left);
    scheduler_.Close(slot);
    troubles_.closed_slots[slot] = left;
  }
  return !found.empty();
}

void EngineCore::ReopenSlots() {
  const absl::Duration now = clock_.Monotonic();
  if (now < next_slot_check_) return;
  {
    const MutexLock lock(mutex_);
    if (troubles_.closed_slots.empty()) return;
  }
  next_slot_check_ = now + kSlotCheckInterval;
  const auto found = executor_.FindProcesses(0, options_.config.scheduler.slots);
  const MutexLock lock(mutex_);
  for (auto closed = troubles_.closed_slots.begin(); closed != troubles_.closed_slots.end();) {
    if (const auto left = found.find(closed->first); left != found.end()) {
      closed->second = left->second;
      ++closed;
      continue;
    }
    spdlog::info("slot {} is open again", closed->first);
    scheduler_.Free(closed->first);
    closed = troubles_.closed_slots.erase(closed);
  }
}

void EngineCore::OnRunnerEnd(LeaseRun& run) {
  const LogScope scope(FieldsOf(run));
  if (!run.report.end().has_value() && !run.report.faulty()) {
    spdlog::error("lease {}: the runner printed: {}", run.lease, run.runner->stderr_tail());
  }
  run.report.Conclude(run.runner->wait_status(), run.runner->stderr_tail());
  if (run.report.faulty()) return Fault(run, kReportFault, run.report.fault());
  AddToJournal(run.context->evaluation.id, [lease = run.lease, attempt = run.attempt,
                                            output = CanonicalJson(OutputJson(*run.report.end())),
                                            who = owner_](Transaction& writer) {
    return writer.blocks.Finish(lease, attempt, output, who);
  });
  Account(run, RunEnd::kDone);
  executor_.NoteEnd(run.runner->site().node, /*fault=*/false);
  const MutexLock lock(mutex_);
  const absl::Duration now = clock_.Monotonic();
  const absl::Duration took = now - live_.at(run.lease).since;
  metrics().ObserveLease(run.context->submission.track, took);
  mean_lease_ = mean_lease_ == absl::ZeroDuration()
                    ? took
                    : mean_lease_ * (1 - kNewest) + took * kNewest;
  live_.erase(run.lease);
  lost_in_a_row_ = 0;
  host_.LeaseDone();
  const Decision decision = scheduler_.Finished(run.lease, run.attempt, now);
  if (decision.kind == Decision::Kind::kEvaluationEnds) to_settle_.insert(decision.evaluation);
}

void EngineCore::Fault(LeaseRun& run, const char* kind, const std::string& why, bool permanent) {
  if (!LookAtDisk() && !permanent) return Return(run, "disk", why);
  const LogScope scope(FieldsOf(run));
  metrics().CountGraderFault(kind);
  spdlog::error("lease {}, attempt {}: fault of the grader: {}", run.lease, run.attempt, why);
  suspect_track_ = run.context->track;
  Account(run, RunEnd::kFault);
  if (run.runner != nullptr) executor_.NoteEnd(run.runner->site().node, /*fault=*/true);
  Decision decision;
  {
    const MutexLock lock(mutex_);
    const absl::Duration now = clock_.Monotonic();
    live_.erase(run.lease);
    // This host's self-test says nothing about another one; the executor watches its nodes.
    if (!executor_.remote() && !permanent) host_.LeaseFaulted(now, why);
    decision = scheduler_.Faulted(run.lease, run.attempt, now, permanent);
  }
  if (decision.kind == Decision::Kind::kRetry) {
    WriteReturn(run, /*fault=*/true, why);
  } else if (decision.kind == Decision::Kind::kGiveUp) {
    GiveUp(decision, run.lease, why, permanent);
  }
}

void EngineCore::GiveUp(const Decision& decision, int64_t failed, const std::string& last,
                        bool permanent) {
  const std::string times = Counted(options_.config.scheduler.max_retries + 1, "time");
  const std::string why =
      permanent ? last : absl::StrCat("a block of episodes failed ", times,
                                      " by the grader's fault, the last time: ", last);
  std::vector<int64_t> others = decision.pending;
  others.insert(others.end(), decision.running.begin(), decision.running.end());
  AddToJournal(decision.evaluation,
               [=, evaluation = decision.evaluation, who = owner_](Transaction& writer) {
    absl::Status status = writer.blocks.End(failed, BlockState::kFailed, /*fault=*/true, who, why);
    for (const int64_t lease : others) {
      status.Update(writer.blocks.End(lease, BlockState::kCancelled, /*fault=*/false, who,
                                    absl::StrCat("block ", failed, " could not be played")));
    }
    status.Update(writer.evaluations.End(evaluation, EvaluationState::kGraderError,
                                       writer.submissions.WithHold(evaluation, why), "", who));
    return status;
  });
  for (const int64_t lease : decision.running) ReclaimAs(lease, RunEnd::kCancelled);
  contexts_.erase(decision.evaluation);
}

void EngineCore::Reclaim(int64_t lease, bool ask) {
  auto node = running_.extract(lease);
  if (node.empty()) return;
  Stop(std::move(node.mapped()), ask);
  const MutexLock lock(mutex_);
  live_.erase(lease);
  troubles_.ending = static_cast<int>(stopping_runners_.size());
}

void EngineCore::Stop(PlacedRunner runner, bool ask) {
  if (ask) runner.runner->AskToEnd();
  const absl::Duration grace = ask ? Runner::kCleanUpGrace : kLongestStay;
  stopping_runners_.push_back({std::move(runner), clock_.Monotonic() + grace, /*stays=*/!ask});
}

// Runners that are stopping: their slots become free when they are dead, and their records are
// rejected.
void EngineCore::ReapStopping() {
  const absl::Duration now = clock_.Monotonic();
  for (auto it = stopping_runners_.begin(); it != stopping_runners_.end();) {
    StoppingRunner& ending = *it;
    // Keep reading, so that a runner blocked in a write can exit.
    if (const auto records = ending.runner->Read(); records.ok()) {
      ending.late += static_cast<int64_t>(records->size());
    }
    if (!ending.runner->dead()) {
      if (!ending.killed && now >= ending.kill_at) {
        ending.killed = true;
        ending.stays = false;
        ending.runner->KillNow();
      }
      ++it;
      continue;
    }
    const LogScope scope({.lease = ending.lease, .attempt = ending.attempt});
    if (ending.late > 0) {
      spdlog::info("lease {}, attempt {}: rejected {} records that arrived after it was reclaimed",
                   ending.lease, ending.attempt, ending.late);
    }
    FreeSlot(ending.slot);
    executor_.CleanUp(ending.work_dir);
    it = stopping_runners_.erase(it);
  }
  const MutexLock lock(mutex_);
  troubles_.ending = static_cast<int>(stopping_runners_.size());
}

// Drops the evaluation: nothing of it is played or settled any more. Reclaims its running leases
// and returns them.
std::set<int64_t> EngineCore::Forget(int64_t evaluation) {
  Decision decision;
  {
    const MutexLock lock(mutex_);
    decision = scheduler_.Cancel(evaluation);
  }
  for (const int64_t lease : decision.running) ReclaimAs(lease, RunEnd::kCancelled);
  deferred_.erase(evaluation);
  to_settle_.erase(evaluation);
  contexts_.erase(evaluation);
  return {decision.running.begin(), decision.running.end()};
}

void EngineCore::GiveUpUnreadable(int64_t evaluation, const std::string& why) {
  const LogScope scope({.evaluation = evaluation});
  const auto [known, is_new] = given_up_.try_emplace(evaluation, why);
  if (!is_new) {
    // This was the write that ends it, and it was rejected too.
    spdlog::error("evaluation {} can't be ended: {}", evaluation, why);
    const MutexLock lock(mutex_);
    troubles_.unreadable[evaluation] = known->second;
    return;
  }
  spdlog::error("evaluation {} can't continue: {}", evaluation, why);
  Forget(evaluation);
  std::erase_if(journal_, [&](const Entry& entry) { return entry.evaluation == evaluation; });
  journal_size_ = std::ssize(journal_);
  AddToJournal(evaluation, [evaluation, why, who = owner_](Transaction& writer) {
    return writer.evaluations.EndUnreadable(evaluation, why, who);
  });
}

absl::StatusOr<std::set<int64_t>> EngineCore::CancelEvaluations(const CancelOrder& order) {
  // Episodes that ended before the cancel stay, and an evaluation whose blocks have all ended is
  // about to get its result.
  RETURN_IF_ERROR(RequireWritable());
  RETURN_IF_ERROR(EnqueueDeferred());
  RETURN_IF_ERROR(SettleAll());
  RETURN_IF_ERROR(RequireWritable());
  // A job that waits for a node has shown nothing to anybody.
  const auto may_have_begun = [&](int64_t evaluation) {
    return !executor_.remote() ||
           std::any_of(running_.begin(), running_.end(), [&](const auto& run) {
             return run.second.begun && run.second.context->evaluation.id == evaluation;
           });
  };
  std::vector<int64_t> open;
  RETURN_IF_ERROR(WriteNow([&](Transaction& writer) -> absl::Status {
    open = writer.evaluations.OpenOf(order.submission, order.reruns);
    for (const int64_t evaluation : open) {
      if (order.charge && may_have_begun(evaluation)) writer.quotas.ChargeBegun(evaluation);
      RETURN_IF_ERROR(writer.evaluations.EndWithBlocks(evaluation, EvaluationState::kCancelled,
                                                       order.why, order.who));
    }
    return absl::OkStatus();
  }));
  if (open.empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat("submission ", order.submission, " has ended; there is nothing to cancel",
                     order.reruns ? "" : ", and only organisers can end its reruns"));
  }
  std::set<int64_t> killed;
  for (const int64_t evaluation : open) killed.merge(Forget(evaluation));
  return killed;
}

void EngineCore::Cancel(const CancelOrder& order, CancelAnswer answer) {
  const absl::Duration begin = clock_.Monotonic();
  absl::StatusOr<std::set<int64_t>> killed = CancelEvaluations(order);
  if (!killed.ok()) return answer(killed.status());
  cancels_.push_back({*std::move(killed), begin, std::move(answer)});
  AnswerCancels();
}

void EngineCore::AnswerCancels() {
  const absl::Duration now = clock_.Monotonic();
  std::erase_if(cancels_, [&](const CancelWait& wait) {
    CancelReport report{static_cast<int>(wait.leases.size()), now - wait.begin, 0};
    for (const StoppingRunner& ending : stopping_runners_) {
      report.still_ending += wait.leases.contains(ending.lease);
    }
    if (report.still_ending > 0 && report.took < kCancelAnswer) return false;
    wait.answer(report);
    return true;
  });
}

}  // namespace myograde::server
