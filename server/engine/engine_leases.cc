// Starts leases and reads from their runners.
#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"
#include "server/artefact/adapters.h"
#include "server/engine/engine_core.h"
#include "server/engine/stored.h"
#include "server/grading/results.h"
#include "server/runner/runner_process.h"

namespace myograde::server {

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
  GiveWay();
}

// Rejudges' leases make room for what teams wait for.
void EngineCore::GiveWay() {
  for (;;) {
    std::optional<GivesWay> lease;
    {
      const MutexLock lock(mutex_);
      if (MayStart()) lease = scheduler_.GiveWay(clock_.Monotonic());
    }
    if (!lease.has_value()) return;
    spdlog::info("lease {} (evaluation {}) of a rejudge gives way to others", lease->lease,
                 lease->evaluation);
    WriteReturn(running_.at(lease->lease), /*fault=*/false, "it gave way to submissions that wait");
    metrics().CountReturn("gave way");
    ReclaimAs(lease->lease, RunEnd::kReturned);
  }
}

void EngineCore::StartLease(const Start& start) {
  LeaseRun run;
  run.context = contexts_.at(start.evaluation);
  run.lease = start.lease;
  run.attempt = start.attempt;
  run.slot = start.slot;
  run.work_dir = absl::StrCat(options_.data_dir, "/work/", run.lease, "-", run.attempt);
  std::tie(run.first, run.last) = run.context->blocks.at(start.lease);
  const int64_t deadline = absl::ToUnixMillis(clock_.Now() + start.lease_wall);
  AddToJournal(start.evaluation, [start, deadline, who = owner_](Transaction& writer) {
    return writer.leases.Start(start.lease, start.attempt, start.slot, deadline, who);
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
  Live& live = live_[run.lease];
  live = {.lease = {.evaluation = start.evaluation,
                    .submission = run.context->submission.id,
                    .slot = run.slot,
                    .process = run.runner->pid(),
                    .begun = run.begun,
                    .episode = run.first},
          .since = now,
          .heard = now};
  live.SetSite(run.runner->site());
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
  row->lease = run.lease;
  row->attempt = run.attempt;
  const bool played = row->outcome == Outcome::kSuccess || row->outcome == Outcome::kFailure;
  metrics().CountEpisode(run.context->submission.track, OutcomeName(row->outcome),
                         /*participant_fault=*/!played);
  AddToJournal(run.context->evaluation.id,
               [row = *std::move(row)](Transaction& writer) -> absl::Status {
                 ASSIGN_OR_RETURN(Recorded recorded, writer.episodes.Record(row));
                 if (!recorded.differs.empty()) {
                   const LogScope about(
                       {.evaluation = row.evaluation, .lease = row.lease, .attempt = row.attempt});
                   spdlog::warn(
                       "evaluation {}, episode {}: played again with another result (policy not "
                       "repeatable)",
                       row.evaluation, row.index);
                 }
                 return absl::OkStatus();
               });
}

}  // namespace myograde::server
