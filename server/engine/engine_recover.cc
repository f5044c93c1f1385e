// Loads evaluations from the store: new ones, and after a start those that an earlier daemon left
// unfinished, in the same way.
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/engine/engine_core.h"
#include "server/grading/results.h"
#include "server/base/peer_key.h"

namespace myograde::server {

namespace {

Priority PriorityOf(const StoredEvaluation& stored) {
  switch (stored.evaluation.kind) {
    case EvaluationKind::kRerun: return Priority::kRerun;
    case EvaluationKind::kRejudge: return Priority::kRejudge;
    case EvaluationKind::kOriginal: break;
  }
  return stored.submission.ranked ? Priority::kRanked : Priority::kPractice;
}

// What an evaluation began with holds for all its leases. Those of earlier versions did not record
// it: they have what is there now.
std::vector<std::pair<std::string, std::string>> RuntimesOf(const StoredEvaluation& stored,
                                                            const Runtimes& runtimes) {
  const nlohmann::json grader = ParsedText(stored.evaluation.grader_json);
  const nlohmann::json recorded =
      grader.is_object() ? grader.value("runtimes", nlohmann::json()) : nlohmann::json();
  std::vector<std::pair<std::string, std::string>> needed;
  for (const std::string& name : stored.artefact.runtimes) {
    const auto digest = recorded.is_object() ? recorded.find(name) : recorded.end();
    if (recorded.is_object() && digest != recorded.end() && digest->is_string()) {
      needed.emplace_back(name, digest->get<std::string>());
    } else {
      const absl::StatusOr<Runtime> present = runtimes.Find(name);
      needed.emplace_back(name, present.ok() ? present->digest : "");
    }
  }
  return needed;
}

}  // namespace

EngineCore::ContextPtr EngineCore::ContextOf(const StoredEvaluation& stored) const {
  const auto context = std::make_shared<Context>();
  context->evaluation = stored.evaluation.id;
  context->submission = stored.submission.id;
  context->track_name = stored.submission.track;
  context->team = stored.submission.team;
  // An organiser submits on behalf of many people, so it counts for no party.
  const std::string& who = stored.submission.accepted_by;
  context->party = IsOrganiser(who) ? "" : who;
  context->priority = PriorityOf(stored);
  context->artefact = stored.artefact.hash;
  context->command = stored.artefact.command;
  context->environment = stored.artefact.environment;
  context->adapter = stored.artefact.adapter;
  context->extra_observations = stored.submission.extra_observations;
  context->image = stored.artefact.image;
  context->runtimes = RuntimesOf(stored, runtimes_);
  context->track = stored.track;
  context->seeds = stored.seeds;
  for (const LeaseRow& lease : stored.leases) {
    context->leases[lease.id] = {lease.first, lease.last};
  }
  context->row = stored.evaluation;
  return context;
}

absl::StatusOr<EngineCore::Loaded> EngineCore::Load(int64_t id) {
  Loaded loaded;
  RETURN_IF_ERROR(readers_.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(StoredEvaluation stored, LoadEvaluation(reader, id, content_));
    loaded.context = ContextOf(stored);
    for (const LeaseRow& lease : stored.leases) {
      if (!IsFinal(lease.state)) loaded.open.push_back(lease);
    }
    return absl::OkStatus();
  }));
  return loaded;
}

absl::Status EngineCore::Enqueue(int64_t id) {
  absl::StatusOr<Loaded> loaded = Load(id);
  if (MayPass(loaded.status())) {
    spdlog::warn("evaluation {} is deferred: {}", id,
                 std::string(loaded.status().message()));
    deferred_.insert(id);
    return absl::OkStatus();
  }
  if (IsBrokenStore(loaded.status())) return loaded.status();
  if (!loaded.ok()) {
    GiveUpUnreadable(id, std::string(loaded.status().message()));
    return absl::OkStatus();
  }
  const Context& context = *loaded->context;
  contexts_[id] = loaded->context;
  if (loaded->open.empty()) {
    to_settle_.insert(id);
    return absl::OkStatus();
  }
  EvaluationSpec spec;
  spec.id = id;
  spec.team = context.team;
  spec.party = context.party;
  spec.priority = context.priority;
  spec.lease_wall =
      absl::Seconds(context.track->config.budgets.lease_wall_s) + options_.config.lease_grace;
  for (const LeaseRow& lease : loaded->open) {
    spec.leases.push_back({lease.id, lease.attempt, lease.faults});
  }
  const MutexLock lock(mutex_);
  scheduler_.Add(spec, clock_.Monotonic());
  return absl::OkStatus();
}

void EngineCore::FollowTeams() {
  std::vector<std::string> teams;
  {
    const MutexLock lock(mutex_);
    teams = scheduler_.Teams();
  }
  std::map<std::string, std::string> names;
  const absl::Status status = readers_.Read([&](Reader& reader) {
    for (const std::string& team : teams) names[team] = reader.TeamOf(team);
    return absl::OkStatus();
  });
  if (!status.ok()) {
    spdlog::warn("the queue keeps the former names of teams: {}", std::string(status.message()));
    return;
  }
  const MutexLock lock(mutex_);
  for (const auto& [team, name] : names) scheduler_.MoveTeam(team, name);
}

absl::Status EngineCore::EnqueueDeferred() {
  for (const int64_t id : std::exchange(deferred_, {})) {
    RETURN_IF_ERROR(Enqueue(id));
  }
  return absl::OkStatus();
}

absl::Status EngineCore::Recover() {
  CloseSlots();
  RETURN_IF_ERROR(RecallDrained());
  Listed<EvaluationRow> unfinished;
  std::map<int64_t, std::vector<LeaseRow>> interrupted;  // by evaluation
  absl::Status status = readers_.Read([&](Reader& reader) {
    unfinished = reader.Unfinished();
    for (const EvaluationRow& evaluation : unfinished.rows) {
      const absl::StatusOr<std::vector<LeaseRow>> leases = reader.Leases(evaluation.id);
      if (!leases.ok()) continue;  // Enqueue runs into the same error
      for (const LeaseRow& lease : *leases) {
        if (lease.state == LeaseState::kRunning) interrupted[evaluation.id].push_back(lease);
      }
    }
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  std::map<int64_t, absl::Status> refused;
  status = disk_.Write([&](Writer& writer) {
    refused.clear();
    for (const auto& [evaluation, open] : interrupted) {
      refused[evaluation] = writer.Part([&leases = open, this](Writer& part) {
        absl::Status returned;
        for (const LeaseRow& lease : leases) {
          returned.Update(part.ReturnLease(lease.id, lease.attempt, /*fault=*/false, owner_,
                                           "an earlier daemon ended while it ran"));
        }
        return returned;
      });
    }
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  for (const auto& [evaluation, why] : refused) {
    if (!why.ok()) GiveUpUnreadable(evaluation, std::string(why.message()));
  }
  for (const Damage& damage : unfinished.damaged) {
    int64_t id = 0;
    if (absl::SimpleAtoi(damage.key, &id)) GiveUpUnreadable(id, DamageText(damage));
  }
  for (const EvaluationRow& evaluation : unfinished.rows) {
    if (given_up_.contains(evaluation.id)) continue;
    if (status = Enqueue(evaluation.id); !status.ok()) return status;
  }
  if (!unfinished.rows.empty()) {
    spdlog::info("resumed {} unfinished evaluations, {} of them with interrupted leases",
                 unfinished.rows.size(), interrupted.size());
  }
  return status;
}

// The evaluation's leases have all ended: its rows decide whether it is done or failed.
absl::Status EngineCore::Settle(int64_t evaluation) {
  const Context& context = *contexts_.at(evaluation);
  std::vector<EpisodeRow> rows;
  absl::Status status = readers_.Read([&](Reader& reader) -> absl::Status {
    absl::StatusOr<std::vector<EpisodeRow>> read =
        WholeEpisodes(reader, context.row, *context.seeds);
    if (read.ok()) rows = *std::move(read);
    return read.status();
  });
  if (!status.ok()) return status;
  ASSIGN_OR_RETURN(const EvaluationResult result, ResultOf(*context.track, rows));
  status = WriteNow([&](Writer& writer) {
    absl::Status written = writer.EndEvaluation(evaluation, result.state, result.reason,
                                                result.results_hash, owner_);
    if (result.state == EvaluationState::kDone && context.row.kind != EvaluationKind::kRerun) {
      written.Update(writer.SetStanding(evaluation, result.standing));
    }
    return written;
  });
  if (status.ok()) {
    const LogScope scope({.evaluation = evaluation,
                          .submission = context.submission,
                          .team = context.team});
    spdlog::info("evaluation {}: {}, {} of {} episodes are successes", evaluation,
                 std::string(EvaluationStateName(result.state)), result.successes,
                 result.episodes);
  }
  return status;
}

}  // namespace myograde::server
