// Starts leases and reads from their runners. On other hosts they begin later than they start, and
// can be lost. All are accounted for.
#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"
#include "server/artefact/adapters.h"
#include "server/engine/engine_core.h"
#include "server/engine/stored.h"
#include "server/grading/results.h"
#include "server/runner/runner_process.h"

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

absl::StatusOr<LeaseOrder> EngineCore::OrderFor(const LeaseRun& run) const {
  const Context& context = *run.context;
  // Artefacts that came with an import may name what this server does not have.
  const ArtefactRow& artefact = context.artefact;
  if (!artefact.adapter.empty() && FindAdapter(artefact.adapter) == nullptr) {
    return absl::NotFoundError(absl::StrCat("there is no adapter \"", artefact.adapter, "\""));
  }
  std::vector<std::string> runtimes;
  for (const auto& [name, digest] : context.runtimes) {
    ASSIGN_OR_RETURN(const Runtime runtime,
                     digest.empty() ? runtimes_.Find(name) : runtimes_.Find(name, digest));
    runtimes.push_back(runtime.folder);
  }
  const TrackConfig& track = context.track->config;
  return MakeLeaseOrder(
      absl::StrCat(run.lease, "-", run.attempt), track,
      EpisodesOf(track, *context.seeds, run.first, run.last),
      {.artefact_dir = ArtefactFolder(options_.data_dir, artefact.hash),
       .command = artefact.command,
       .environment = artefact.environment,
       .runtimes = std::move(runtimes),
       .adapter = artefact.adapter,
       .extra_observations = context.submission.extra_observations,
       .image = artefact.image},
      {.slot = run.slot,
       .uid = -1,
       .pinned = PinsSlots(options_.config, options_.config.scheduler.slots, track),
       .work_dir = run.work_dir,
       .cache_dir = options_.cache_dir,
       .log_dir = options_.data_dir + "/logs"});
}

void EngineCore::StartLeases() {
  for (;;) {
    std::optional<Start> start;
    {
      const MutexLock lock(mutex_);
      if (MayStart()) start = scheduler_.Next(clock_.Monotonic());
    }
    if (!start.has_value()) break;
    StartLease(*start);
  }
  Preempt();
}

// Rejudges' leases make room for what teams wait for.
void EngineCore::Preempt() {
  for (;;) {
    std::optional<Start> given;
    {
      const MutexLock lock(mutex_);
      if (MayStart()) given = scheduler_.Preempt(clock_.Monotonic());
    }
    if (!given.has_value()) return;
    spdlog::info("lease {} (evaluation {}) of a rejudge is preempted", given->lease,
                 given->evaluation);
    WriteReturn(running_.at(given->lease), /*fault=*/false,
                "it was preempted by waiting submissions");
    metrics().CountReturn("preempted");
    ReclaimAs(given->lease, RunEnd::kReturned);
  }
}

void EngineCore::StartLease(const Start& start) {
  LeaseRun run;
  run.context = contexts_.at(start.evaluation);
  run.lease = start.lease;
  run.attempt = start.attempt;
  run.slot = start.slot;
  run.work_dir = absl::StrCat(options_.data_dir, "/work/", run.lease, "-", run.attempt);
  std::tie(run.first, run.last) = run.context->ranges.at(start.lease);
  const int64_t deadline = absl::ToUnixMillis(clock_.Now() + start.lease_wall);
  AddToJournal(start.evaluation, [start, deadline, who = owner_](Transaction& writer) {
    return writer.blocks.Start(start.lease, start.attempt, start.slot, deadline, who);
  });
  const absl::StatusOr<LeaseOrder> order = OrderFor(run);
  // The scheduler watches for lateness and silence.
  if (order.ok()) run.report = LeaseReport(order->episodes, {}, clock_.Monotonic());
  absl::StatusOr<std::unique_ptr<Runner>> runner =
      order.ok() ? executor_.Start(*order, {.artefact = run.context->artefact.hash,
                                          .runtimes = run.context->runtimes,
                                          .wall = start.lease_wall})
                 : absl::StatusOr<std::unique_ptr<Runner>>(order.status());
  const LogScope scope(FieldsOf(run));
  if (!runner.ok()) {
    FreeSlot(run.slot);
    const bool missing = absl::IsNotFound(order.status());
    Fault(run, "start",
          absl::StrCat(missing ? "a block of episodes can't be played: "
                               : "the runner did not start: ", runner.status().message()),
          /*permanent=*/missing);
    return;
  }
  run.runner = *std::move(runner);
  run.begun = !executor_.remote();
  if (run.begun) run.began_at = absl::ToUnixMillis(clock_.Now());
  spdlog::info("lease {} (evaluation {}, episodes {} to {}): attempt {} on slot {}, process {}",
               run.lease, start.evaluation, run.first, run.last, run.attempt, start.slot,
               run.runner->pid());
  const MutexLock lock(mutex_);
  const absl::Duration now = clock_.Monotonic();
  live_[run.lease] = {.lease = {.evaluation = start.evaluation,
                                .submission = run.context->submission.id,
                                .slot = run.slot,
                                .process = run.runner->pid(),
                                .site = run.runner->site(),
                                .begun = run.begun,
                                .episode = run.first},
                      .since = now,
                      .heard = now};
  running_[run.lease] = std::move(run);
}

void EngineCore::Listen(LeaseRun& run) {
  if (executor_.remote()) FollowSite(run);
  absl::StatusOr<std::vector<LeaseRecord>> records = run.runner->Read();
  if (!records.ok()) return run.report.Fail(std::string(records.status().message()));
  if (records->empty() || run.report.faulty()) return;
  const absl::Duration now = clock_.Monotonic();
  const LeaseReport::News news = run.report.Take(*records, now);
  for (const EpisodeFacts& facts : news.episodes) OnEpisode(run, facts);
  const MutexLock lock(mutex_);
  scheduler_.Heartbeat(run.lease, run.attempt, now);
  Live& live = live_.at(run.lease);
  live.heard = now;
  if (!news.progress.has_value()) return;
  live.lease.episode = news.progress->episode;
  live.lease.step = news.progress->step;
}

void EngineCore::OnEpisode(LeaseRun& run, const EpisodeFacts& facts) {
  absl::StatusOr<EpisodeRow> row = JudgedRow(*run.context->track, facts);
  if (!row.ok()) return run.report.Fail(std::string(row.status().message()));
  row->evaluation = run.context->evaluation.id;
  row->block = run.lease;
  row->attempt = run.attempt;
  const bool played = row->outcome == Outcome::kSuccess || row->outcome == Outcome::kFailure;
  metrics().CountEpisode(run.context->submission.track, OutcomeName(row->outcome),
                         /*participant_fault=*/!played);
  AddToJournal(run.context->evaluation.id,
               [row = *std::move(row)](Transaction& writer) -> absl::Status {
                 ASSIGN_OR_RETURN(const auto differs, writer.episodes.Record(row));
                 if (!differs.empty()) {
                   const LogScope about(
                       {.evaluation = row.evaluation, .lease = row.block, .attempt = row.attempt});
                   spdlog::warn(
                       "evaluation {}, episode {}: repeated with a different result (the policy "
                       "is not repeatable)",
                       row.evaluation, row.index);
                 }
                 return absl::OkStatus();
               });
}

bool EngineCore::MayStart() const {
  return host_.may_start() && troubles_.executor_trouble.empty() && troubles_.disk_trouble.empty();
}

// The executor's news, before its runners are asked.
void EngineCore::AttendExecutor() {
  const std::string trouble = executor_.CannotStart();
  for (const DrainedNode& drained : executor_.TakeDrained()) {
    spdlog::error("node {} gets no more leases: {}", drained.node, drained.why);
    AddToJournal(0, [drained, who = owner_](Transaction& writer) {
      return Note(writer, [&](Transaction& part) {
        return part.blocks.SetNode(drained.node, /*drained=*/true, drained.why, who);
      });
    });
  }
  const MutexLock lock(mutex_);
  if (trouble == troubles_.executor_trouble) return;
  if (trouble.empty()) {
    spdlog::info("leases can start again");
  } else {
    // What is no part of a healthy start, the executor has logged as an error.
    spdlog::info("no lease can start: {}", trouble);
  }
  troubles_.executor_trouble = trouble;
}

// The nodes that were drained before this start.
absl::Status EngineCore::RecallDrained() {
  if (!executor_.remote()) return absl::OkStatus();
  using Drained = Listed<DrainedNodeRow>;
  ASSIGN_OR_RETURN(const Drained drained, readers_.Read<Drained>([](const Transaction& reader) {
    return reader.blocks.DrainedNodes();
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
  live.lease.site = run.runner->site();
  if (!begins) return;
  const absl::Duration now = clock_.Monotonic();
  run.begun = live.lease.begun = true;
  run.began_at = absl::ToUnixMillis(clock_.Now());
  live.since = live.heard = now;
  scheduler_.Begun(run.lease, run.attempt, now);
  spdlog::info("lease {} starts on node {}, job {}", run.lease, live.lease.site.node,
               live.lease.site.job);
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
  if (decision.kind == Decision::Kind::kGiveUp) return GiveUp(decision, run.lease, why);
  if (decision.kind == Decision::Kind::kRetry) WriteReturn(run, decision.fault, why);
}

// An attempt has ended, or nothing more of it counts. One that never had a runner used nothing.
void EngineCore::Account(const LeaseRun& run, RunEnd how) {
  if (run.runner == nullptr) return;
  const RunnerSite site = run.runner->site();
  const AttemptRow row = {.block = run.lease,
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
    return Note(writer, [&](Transaction& part) { return part.blocks.RecordAttempt(row); });
  });
}

void EngineCore::ReclaimAs(int64_t lease, RunEnd how) {
  const auto run = running_.find(lease);
  if (run == running_.end()) return;
  Account(run->second, how);
  Reclaim(lease);
}

}  // namespace myograde::server
