// Leases on other hosts: they begin later than they start, can be lost, and are accounted for.
#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"
#include "server/engine/engine_core.h"

namespace myograde::server {
namespace {

// Writes what people are told and no decision hangs on: if the store refuses it, nothing else is lost.
absl::Status Note(Transaction& writer, const std::function<absl::Status(Transaction&)>& note) {
  absl::Status written = writer.Part(note);
  if (written.ok() || MayPass(written)) return written;
  spdlog::error("not recorded: {}", std::string(written.message()));
  return absl::OkStatus();
}

}  // namespace

bool EngineCore::MayStart() const {
  return host_.may_start() && executor_trouble_.empty() && disk_trouble_.empty();
}

// The executor's news, before its runners are asked.
void EngineCore::AttendExecutor() {
  const std::string trouble = executor_.CannotStart();
  for (const DrainedNode& drained : executor_.TakeDrained()) {
    spdlog::error("node {} gets no more leases: {}", drained.node, drained.why);
    AddToJournal(0, [drained, who = owner_](Transaction& writer) {
      return Note(writer, [&](Transaction& part) {
        return part.leases.DrainNode(drained.node, drained.why, who);
      });
    });
  }
  const MutexLock lock(mutex_);
  if (trouble == executor_trouble_) return;
  if (trouble.empty()) {
    spdlog::info("leases can start again");
  } else {
    // What is no part of a healthy start, the executor has logged as an error.
    spdlog::info("no lease can start: {}", trouble);
  }
  executor_trouble_ = trouble;
}

// The nodes that were drained before this start.
absl::Status EngineCore::RecallDrained() {
  if (!executor_.remote()) return absl::OkStatus();
  using Drained = Listed<DrainedNodeRow>;
  ASSIGN_OR_RETURN(const Drained drained, readers_.Read<Drained>([](const Transaction& reader) {
    return reader.leases.DrainedNodes();
  }));
  for (const DrainedNodeRow& row : drained.rows) {
    const absl::Status kept = executor_.Drain(row.node, row.why);
    if (!kept.ok()) spdlog::error("{}", std::string(kept.message()));
  }
  return absl::OkStatus();
}

void EngineCore::FollowSite(LeaseRun& run) {
  const bool begins = !run.begun && run.runner->begun();
  const MutexLock lock(mutex_);
  Live& live = live_.at(run.lease);
  live.SetSite(run.runner->site());
  if (!begins) return;
  const absl::Duration now = clock_.Monotonic();
  run.begun = live.lease.begun = true;
  run.began_at = absl::ToUnixMillis(clock_.Now());
  live.since = live.heard = now;
  scheduler_.Begun(run.lease, run.attempt, now);
  spdlog::info("lease {} begins on node {}, job {}", run.lease, live.lease.node, live.lease.job);
}

// Nobody is at fault: the lease is played again.
void EngineCore::Return(LeaseRun& run, const char* kind, const std::string& why) {
  const LogScope scope(FieldsOf(run));
  spdlog::warn("lease {}, attempt {}: lost: {}", run.lease, run.attempt, why);
  Account(run, RunEnd::kReturned);
  metrics().CountReturn(kind);
  Decision decision;
  {
    const MutexLock lock(mutex_);
    live_.erase(run.lease);
    ++lost_in_a_row_;
    last_loss_ = why;
    decision = scheduler_.Returned(run.lease, run.attempt, clock_.Monotonic());
  }
  if (decision.kind == Decision::Kind::kGiveUp) return GiveUp(decision, run.lease, AfterRetries(why));
  if (decision.kind == Decision::Kind::kRetry) WriteReturn(run, decision.fault, why);
}

// An attempt has ended, or nothing more of it counts. One that never had a runner used nothing.
void EngineCore::Account(const LeaseRun& run, RunEnd how) {
  if (run.runner == nullptr) return;
  const RunnerSite site = run.runner->site();
  const LeaseRunRow row = {.lease = run.lease,
                           .attempt = run.attempt,
                           .node = site.node,
                           .job = site.job,
                           .began_at = run.began_at,
                           .ended_at = absl::ToUnixMillis(clock_.Now()),
                           .cpu_s = site.cpu_s,
                           .energy_j = site.energy_j,
                           .how = how};
  metrics().CountUse(run.context->submission.track, site.cpu_s, site.energy_j.value_or(0));
  AddToJournal(run.context->evaluation.id, [row](Transaction& writer) {
    return Note(writer, [&](Transaction& part) { return part.leases.RecordRun(row); });
  });
}

void EngineCore::ReclaimAs(int64_t lease, RunEnd how) {
  const auto run = running_.find(lease);
  if (run == running_.end()) return;
  Account(run->second, how);
  Reclaim(lease);
}

}  // namespace myograde::server
