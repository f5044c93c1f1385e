// Taking evaluations up from the store: new ones, and after a start those that
// an earlier daemon left unfinished. One way for both.
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

#include "protocol/config_reader.h"
#include "server/daemon/engine_core.h"
#include "server/daemon/results.h"

namespace myograde::server {

absl::StatusOr<TrackPtr> EngineCore::TrackOf(Reader& reader, const std::string& config_hash) {
  if (const auto it = tracks_.find(config_hash); it != tracks_.end()) return it->second;
  absl::StatusOr<std::string> text = reader.ConfigJson(config_hash);
  if (!text.ok()) return text.status();
  const std::string where = absl::StrCat("the store's config ", config_hash);
  absl::StatusOr<nlohmann::json> json = ParseJson(*text, where);
  if (!json.ok()) return json.status();
  absl::StatusOr<TrackConfig> config = ParseTrackConfig(*json, where);
  if (!config.ok()) return config.status();
  absl::StatusOr<TrackPtr> track = MakeTrack(*std::move(config));
  if (track.ok()) tracks_[config_hash] = *track;
  return track;
}

absl::StatusOr<EngineCore::SeedsPtr> EngineCore::SeedsOf(Reader& reader, const std::string& hash) {
  if (SeedsPtr known = seeds_[hash].lock()) return known;
  if (seeds_.size() > 2 * contexts_.size() + 16) {
    std::erase_if(seeds_, [](const auto& entry) { return entry.second.expired(); });
  }
  absl::StatusOr<std::string> text = reader.SeedsJson(hash);
  if (!text.ok()) return text.status();
  absl::StatusOr<nlohmann::json> json = ParseJson(*text, "the store's seed list");
  if (!json.ok()) return json.status();
  const auto seeds =
      std::make_shared<const std::vector<uint64_t>>(json->get<std::vector<uint64_t>>());
  seeds_[hash] = seeds;
  return seeds;
}

absl::StatusOr<EngineCore::Loaded> EngineCore::Load(int64_t id) {
  Loaded loaded;
  const auto context = std::make_shared<Context>();
  const absl::Status status = readers_.Read([&](Reader& reader) -> absl::Status {
    absl::StatusOr<EvaluationRow> evaluation = reader.Evaluation(id);
    if (!evaluation.ok()) return evaluation.status();
    absl::StatusOr<SubmissionRow> submission = reader.Submission(evaluation->submission);
    if (!submission.ok()) return submission.status();
    absl::StatusOr<ArtefactRow> artefact = reader.Artefact(submission->artefact);
    if (!artefact.ok()) return artefact.status();
    absl::StatusOr<TrackPtr> track = TrackOf(reader, submission->config);
    if (!track.ok()) return track.status();
    absl::StatusOr<SeedsPtr> seeds = SeedsOf(reader, submission->seeds);
    if (!seeds.ok()) return seeds.status();
    context->evaluation = id;
    context->submission = submission->id;
    context->team = submission->team;
    context->priority = evaluation->rerun    ? Priority::kRerun
                        : submission->ranked ? Priority::kOfficial
                                             : Priority::kPractice;
    context->artefact = artefact->hash;
    context->command = artefact->command;
    context->track = *track;
    context->seeds = *std::move(seeds);
    for (const std::string& runtime : artefact->runtimes) {
      const auto it = options_.config.runtimes.find(runtime);
      // A runtime that was taken out of the settings is the grader's fault, told by the runner.
      context->runtimes.push_back(it == options_.config.runtimes.end() ? "/nonexistent/" + runtime
                                                                       : it->second);
    }
    for (const LeaseRow& lease : reader.Leases(id)) {
      context->leases[lease.id] = {lease.first, lease.last};
      if (!IsFinal(lease.state)) loaded.open.push_back(lease);
    }
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  loaded.context = context;
  return loaded;
}

absl::Status EngineCore::TakeUp(int64_t id) {
  absl::StatusOr<Loaded> loaded = Load(id);
  if (MayPass(loaded.status())) {
    spdlog::warn("evaluation {} is taken up later: {}", id,
                 std::string(loaded.status().message()));
    to_take_up_.insert(id);
    return absl::OkStatus();
  }
  if (!loaded.ok()) return loaded.status();
  const Context& context = *loaded->context;
  contexts_[id] = loaded->context;
  if (loaded->open.empty()) {
    to_settle_.insert(id);
    return absl::OkStatus();
  }
  EvaluationSpec spec;
  spec.id = id;
  spec.team = context.team;
  spec.priority = context.priority;
  spec.lease_wall =
      absl::Seconds(context.track->config.budgets.lease_wall_s) + options_.config.lease_grace;
  for (const LeaseRow& lease : loaded->open) {
    spec.leases.push_back({lease.id, lease.attempt, lease.faults});
  }
  const std::lock_guard lock(mutex_);
  scheduler_.Add(spec, clock_.Monotonic());
  return absl::OkStatus();
}

absl::Status EngineCore::TakeUpLate() {
  for (const int64_t id : std::exchange(to_take_up_, {})) {
    if (absl::Status status = TakeUp(id); !status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::Status EngineCore::Recover() {
  std::vector<EvaluationRow> unfinished;
  std::vector<LeaseRow> interrupted;
  absl::Status status = readers_.Read([&](Reader& reader) {
    unfinished = reader.Unfinished();
    for (const EvaluationRow& evaluation : unfinished) {
      for (const LeaseRow& lease : reader.Leases(evaluation.id)) {
        if (lease.state == LeaseState::kRunning) interrupted.push_back(lease);
      }
    }
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  status = disk_.Write([&](Writer& writer) {
    absl::Status written;
    for (const LeaseRow& lease : interrupted) {
      written.Update(writer.ReturnLease(lease.id, lease.attempt, /*fault=*/false, owner_,
                                        "an earlier daemon ended while it ran"));
    }
    return written;
  });
  for (const EvaluationRow& evaluation : unfinished) {
    if (status.ok()) status = TakeUp(evaluation.id);
  }
  if (status.ok() && !unfinished.empty()) {
    spdlog::info("{} unfinished evaluations taken up, {} leases of them were running",
                 unfinished.size(), interrupted.size());
  }
  return status;
}

// The evaluation's leases are all done: its rows make it done or failed.
absl::Status EngineCore::Settle(int64_t evaluation) {
  std::vector<EpisodeRow> rows;
  absl::Status status = readers_.Read([&](Reader& reader) {
    rows = reader.Episodes(evaluation);
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  absl::StatusOr<scoring::Aggregate> aggregate = AggregateRows(rows);
  if (!aggregate.ok()) return aggregate.status();
  const EvaluationState state =
      aggregate->failed ? EvaluationState::kFailed : EvaluationState::kDone;
  const std::string reason =
      aggregate->failed ? "every episode ended by a fault of the participant's program" : "";
  const Context& context = *contexts_.at(evaluation);
  const std::string standing =
      CanonicalJson(AggregateToJson(context.track->config.kind, *aggregate));
  status = WriteNow([&](Writer& writer) {
    absl::Status written =
        writer.EndEvaluation(evaluation, state, reason, ResultsHash(rows), owner_);
    if (state == EvaluationState::kDone && context.priority != Priority::kRerun) {
      written.Update(writer.SetStanding(evaluation, standing));
    }
    return written;
  });
  if (status.ok()) {
    spdlog::info("evaluation {}: {}, {} of {} episodes are successes", evaluation,
                 std::string(EvaluationStateName(state)), aggregate->successes,
                 aggregate->episodes);
  }
  return status;
}

}  // namespace myograde::server
