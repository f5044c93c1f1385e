// Loads evaluations from the store: new ones, and after a start those that an earlier daemon left
// unfinished, in the same way.
#include <absl/strings/numbers.h>
#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"
#include "server/base/peer_key.h"
#include "server/engine/engine_core.h"
#include "server/grading/results.h"

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

// What an evaluation began with holds for all its leases.
std::vector<std::pair<std::string, std::string>> RuntimesOf(const StoredEvaluation& stored) {
  const nlohmann::json grader = ParsedText(stored.evaluation.grader_json);
  const nlohmann::json recorded = grader.is_object()
                                      ? grader.value("runtimes", nlohmann::json::object())
                                      : nlohmann::json::object();
  std::vector<std::pair<std::string, std::string>> needed;
  for (const std::string& name : stored.artefact.runtimes) {
    needed.emplace_back(name, recorded.value(name, ""));
  }
  return needed;
}

}  // namespace

absl::Status EngineCore::Enqueue(int64_t id) {
  absl::StatusOr<StoredEvaluation> stored = readers_.Read<StoredEvaluation>(
      [&](const Transaction& reader) { return LoadEvaluation(reader, id, content_); });
  if (MayPass(stored.status())) {
    spdlog::warn("evaluation {} is deferred: {}", id, std::string(stored.status().message()));
    deferred_.insert(id);
    return absl::OkStatus();
  }
  if (IsBrokenStore(stored.status())) return stored.status();
  if (!stored.ok()) {
    GiveUpUnreadable(id, std::string(stored.status().message()));
    return absl::OkStatus();
  }
  EvaluationSpec spec;
  const auto context = std::make_shared<Context>(Context{*std::move(stored), {}, {}});
  context->runtimes = RuntimesOf(*context);
  // Their rows change, and those that have ended are large.
  for (const BlockRow& block : std::exchange(context->blocks, {})) {
    context->ranges[block.id] = {block.first, block.last};
    if (!IsFinal(block.state)) spec.blocks.push_back({block.id, block.attempt, block.faults});
  }
  contexts_[id] = context;
  if (spec.blocks.empty()) {
    to_settle_.insert(id);
    return absl::OkStatus();
  }
  spec.id = id;
  spec.team = context->submission.team;
  // An organiser submits on behalf of many people, so it counts for no submitter.
  const std::string& who = context->submission.accepted_by;
  spec.submitter = IsOrganiser(who) ? "" : who;
  spec.priority = PriorityOf(*context);
  spec.lease_wall =
      absl::Seconds(context->track->config.budgets.lease_wall_s) + options_.config.lease_grace;
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
  using Names = std::map<std::string, std::string>;
  const absl::StatusOr<Names> names = readers_.Read<Names>([&](const Transaction& reader) {
    Names found;
    for (const std::string& team : teams) found[team] = reader.teams.NameOf(team);
    return found;
  });
  if (!names.ok()) {
    spdlog::warn("the queue keeps the former names of teams: {}",
                 std::string(names.status().message()));
    return;
  }
  const MutexLock lock(mutex_);
  for (const auto& [team, name] : *names) scheduler_.MoveTeam(team, name);
}

absl::Status EngineCore::EnqueueDeferred() {
  for (const int64_t id : std::exchange(deferred_, {})) {
    RETURN_IF_ERROR(Enqueue(id));
  }
  return absl::OkStatus();
}

absl::Status EngineCore::Recover() {
  CloseSlots(0, options_.config.scheduler.slots);
  RETURN_IF_ERROR(RecallDrained());
  Listed<EvaluationRow> unfinished;
  std::map<int64_t, absl::Status> interrupted;  // evaluations with leases that are returned
  RETURN_IF_ERROR(disk_.Write([&](Transaction& writer) {
    unfinished = writer.evaluations.Unfinished();
    interrupted.clear();
    for (const EvaluationRow& evaluation : unfinished.rows) {
      absl::StatusOr<std::vector<BlockRow>> blocks = writer.blocks.Of(evaluation.id);
      if (!blocks.ok()) continue;  // Enqueue runs into the same error
      std::erase_if(*blocks, [](const BlockRow& row) { return row.state != BlockState::kRunning; });
      if (blocks->empty()) continue;
      interrupted[evaluation.id] = writer.Part([&](Transaction& part) {
        absl::Status returned;
        for (const BlockRow& block : *blocks) {
          returned.Update(part.blocks.Return(block.id, block.attempt, /*fault=*/false, owner_,
                                             "an earlier daemon ended while it ran"));
        }
        return returned;
      });
    }
    return absl::OkStatus();
  }));
  for (const auto& [evaluation, why] : interrupted) {
    if (!why.ok()) GiveUpUnreadable(evaluation, std::string(why.message()));
  }
  for (const Damage& damage : unfinished.damaged) {
    int64_t id = 0;
    if (absl::SimpleAtoi(damage.key, &id)) GiveUpUnreadable(id, DamageText(damage));
  }
  for (const EvaluationRow& evaluation : unfinished.rows) {
    if (given_up_.contains(evaluation.id)) continue;
    RETURN_IF_ERROR(Enqueue(evaluation.id));
  }
  if (!unfinished.rows.empty()) {
    spdlog::info("resumed {} unfinished evaluations, {} of them with interrupted leases",
                 unfinished.rows.size(), interrupted.size());
  }
  return absl::OkStatus();
}

// The evaluation's blocks have all ended: its rows decide whether it is done or failed.
absl::Status EngineCore::Settle(int64_t evaluation) {
  const Context& context = *contexts_.at(evaluation);
  using Rows = std::vector<EpisodeRow>;
  ASSIGN_OR_RETURN(const Rows rows, readers_.Read<Rows>([&](const Transaction& reader) {
    return WholeEpisodes(reader, context.evaluation, *context.seeds);
  }));
  ASSIGN_OR_RETURN(const EvaluationResult result, ComputeResult(*context.track, rows));
  RETURN_IF_ERROR(WriteNow([&](Transaction& writer) {
    absl::Status written = writer.evaluations.End(evaluation, result.state, result.reason,
                                                result.results_hash, owner_);
    if (result.state == EvaluationState::kDone &&
        context.evaluation.kind != EvaluationKind::kRerun) {
      written.Update(writer.episodes.SetStanding(evaluation, result.aggregate));
    }
    return written;
  }));
  const LogScope scope({.evaluation = evaluation,
                        .submission = context.submission.id,
                        .team = context.submission.team});
  spdlog::info("evaluation {}: {}, {} of {} episodes succeeded", evaluation,
               std::string(EnumName(result.state)), At(result.aggregate, "successes").dump(),
               At(result.aggregate, "episodes").dump());
  return absl::OkStatus();
}

}  // namespace myograde::server
