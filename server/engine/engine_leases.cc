// Starting leases and hearing their runners.
#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/lease/policy_seed.h"
#include "server/engine/engine_core.h"
#include "server/grading/results.h"

namespace myograde::server {

LeaseOrder EngineCore::OrderFor(const LeaseRun& run) const {
  LeaseOrder order;
  order.lease = absl::StrCat(run.lease, "-", run.attempt);
  order.artefact_dir = absl::StrCat(options_.data_dir, "/artefacts/", run.context->artefact);
  order.command = run.context->command;
  order.environment = run.context->environment;
  order.runtimes = run.context->runtimes;
  order.track = run.context->track->config;
  const Form1PolicySeeds form1 = {disk_.policy_secret(), run.context->artefact};
  for (int64_t index = run.first; index <= run.last; ++index) {
    order.episodes.push_back({index, (*run.context->seeds)[static_cast<size_t>(index)],
                              PolicySeed(order.track, form1, index)});
  }
  order.slot = run.slot;
  order.pinned = PinsSlots(options_.config, options_.config.scheduler.slots, order.track);
  order.work_dir = run.work_dir;
  order.cache_dir = options_.cache_dir;
  order.log_dir = options_.data_dir + "/logs";
  return order;
}

void EngineCore::StartLeases() {
  for (;;) {
    std::optional<Start> start;
    {
      const std::lock_guard lock(mutex_);
      if (host_.may_start()) start = scheduler_.Next(clock_.Monotonic());
    }
    if (!start.has_value()) return;
    StartLease(*start);
  }
}

void EngineCore::StartLease(const Start& start) {
  LeaseRun run;
  run.context = contexts_.at(start.evaluation);
  run.lease = start.lease;
  run.attempt = start.attempt;
  run.slot = start.slot;
  run.work_dir = absl::StrCat(options_.data_dir, "/work/", run.lease, "-", run.attempt);
  std::tie(run.first, run.last) = run.context->leases.at(start.lease);
  const int64_t deadline = absl::ToUnixMillis(clock_.Now() + start.lease_wall);
  Later(start.evaluation, [start, deadline, who = owner_](Writer& writer) {
    return writer.StartLease(start.lease, start.attempt, start.slot, deadline, who);
  });
  absl::StatusOr<std::unique_ptr<Runner>> runner = processes_.Start(OrderFor(run));
  if (!runner.ok()) {
    FreeSlot(run.slot);
    Fault(run, absl::StrCat("the runner did not start: ", runner.status().message()));
    return;
  }
  run.runner = *std::move(runner);
  spdlog::info("lease {} (evaluation {}, episodes {} to {}): attempt {} on slot {}, process {}",
               run.lease, start.evaluation, run.first, run.last, run.attempt, start.slot,
               run.runner->pid());
  const std::lock_guard lock(mutex_);
  const absl::Duration now = clock_.Monotonic();
  live_[run.lease] = {start.evaluation, run.context->submission, run.slot, run.runner->pid(),
                      run.first, 0, now, now};
  running_[run.lease] = std::move(run);
}

void EngineCore::Listen(LeaseRun& run) {
  absl::StatusOr<std::vector<LeaseRecord>> records = run.runner->Read();
  if (!records.ok()) {
    if (run.fault.empty()) run.fault = std::string(records.status().message());
    return;
  }
  for (const LeaseRecord& record : *records) {
    if (!run.fault.empty()) return;  // nothing counts after the grader's fault
    if (const auto* progress = std::get_if<ProgressRecord>(&record)) OnProgress(run, *progress);
    if (const auto* facts = std::get_if<EpisodeFacts>(&record)) OnEpisode(run, *facts);
    const absl::Duration now = clock_.Monotonic();
    if (const auto* end = std::get_if<LeaseEndRecord>(&record)) {
      run.end = *end;
      run.end_heard = now;
    }
    const std::lock_guard lock(mutex_);
    scheduler_.Heartbeat(run.lease, run.attempt, now);
    live_.at(run.lease).heard = now;
  }
}

void EngineCore::OnProgress(LeaseRun& run, const ProgressRecord& record) {
  const std::lock_guard lock(mutex_);
  Live& live = live_.at(run.lease);
  live.episode = record.episode;
  live.step = record.step;
}

void EngineCore::OnEpisode(LeaseRun& run, const EpisodeFacts& facts) {
  if (facts.index < run.first || facts.index > run.last || run.recorded.contains(facts.index) ||
      facts.seed != (*run.context->seeds)[static_cast<size_t>(facts.index)]) {
    run.fault = absl::StrCat("the runner told of episode ", facts.index, " with seed ", facts.seed,
                             ", which the lease did not ask for");
    return;
  }
  absl::StatusOr<EpisodeRow> row = JudgedRow(*run.context->track, facts);
  if (!row.ok()) {
    run.fault = std::string(row.status().message());
    return;
  }
  row->evaluation = run.context->evaluation;
  row->lease = run.lease;
  row->attempt = run.attempt;
  run.recorded.insert(facts.index);
  Later(run.context->evaluation, [row = *std::move(row)](Writer& writer) -> absl::Status {
    absl::StatusOr<Recorded> recorded = writer.RecordEpisode(row);
    if (!recorded.ok()) return recorded.status();
    if (!recorded->differs.empty()) {
      spdlog::warn("evaluation {}, episode {}: played again, and came out otherwise (policy not "
                   "repeatable)", row.evaluation, row.index);
    }
    return absl::OkStatus();
  });
}

}  // namespace myograde::server
