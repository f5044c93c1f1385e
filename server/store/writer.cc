// The operations of a change. SQLite exceptions propagate to Store::Write.
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"
#include "protocol/tracks/registry.h"
#include "server/store/artefact_options.h"
#include "server/store/connection.h"
#include "server/store/differences.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

std::string Text(std::string_view view) { return std::string(view); }

absl::Status Refuse(const char* what, const LeaseRow& lease, std::string_view step) {
  return absl::FailedPreconditionError(
      absl::StrCat("lease ", lease.id, " can't be ", what, ": it is ",
                   Text(LeaseStateName(lease.state)), ", attempt ", lease.attempt, Text(step)));
}

}  // namespace

absl::Status Writer::Audit(const char* entity, int64_t id, std::string_view from,
                           std::string_view to, const std::string& who, const std::string& why) {
  SQLite::Statement insert(db_,
                           "INSERT INTO transition (at, entity, entity_id, from_state, to_state, "
                           "who, why) VALUES (?, ?, ?, ?, ?, ?, ?)");
  SQLite::bind(insert, now_ms_, entity, id, Text(from), Text(to), who, why);
  insert.exec();
  return absl::OkStatus();
}

absl::StatusOr<LeaseRow> Writer::Lease(int64_t lease) {
  SQLite::Statement select(
      db_, "SELECT evaluation, first, last, state, attempt, faults FROM lease WHERE id = ?");
  select.bind(1, lease);
  if (!select.executeStep()) return absl::NotFoundError(absl::StrCat("there is no lease ", lease));
  StoredRow row(select, "lease", absl::StrCat(lease));
  LeaseRow read;
  read.id = lease;
  read.evaluation = row.Number(0, 1, INT64_MAX);
  read.first = row.Number(1, 0, kMaxEpisodes - 1);
  read.last = row.Number(2, read.first, kMaxEpisodes - 1);
  read.state = row.Named(3, ParseLeaseState);
  read.attempt = row.Number(4, 0, INT64_MAX - 1);
  read.faults = row.Number(5, 0, read.attempt);
  if (!row.ok()) return row.status();
  return read;
}

absl::StatusOr<bool> Writer::AddArtefact(const ArtefactRow& artefact) {
  SQLite::Statement insert(db_,
                           "INSERT INTO artefact VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?) "
                           "ON CONFLICT DO NOTHING");
  SQLite::bind(insert, artefact.hash, artefact.name,
               CanonicalJson(nlohmann::json(artefact.command)),
               CanonicalJson(nlohmann::json(artefact.runtimes)), artefact.bytes, artefact.files,
               now_ms_, CanonicalJson(nlohmann::json(artefact.environment)), ArtefactOptionsOf(artefact));
  return insert.exec() == 1;
}

absl::StatusOr<Accepted> Writer::AddRerun(const NewRerun& rerun, const std::string& who) {
  return AddEvaluation({.submission = rerun.submission,
                        .kind = EvaluationKind::kRerun,
                        .grader_json = rerun.grader_json,
                        .blocks = rerun.blocks},
                       who);
}

absl::StatusOr<Accepted> Writer::AddEvaluation(const NewEvaluation& added,
                                               const std::string& who) {
  const std::vector<std::pair<int64_t, int64_t>>& blocks = added.blocks;
  if (blocks.empty()) return absl::InvalidArgumentError("an evaluation needs at least one lease");
  SQLite::Statement insert(db_,
                           "INSERT INTO evaluation (submission, kind, first, last, state, "
                           "grader_json, created_at, config, seeds) "
                           "VALUES (?, ?, ?, ?, 'queued', ?, ?, nullif(?, ''), nullif(?, ''))");
  SQLite::bind(insert, added.submission, Text(EvaluationKindName(added.kind)),
               blocks.front().first, blocks.back().second, added.grader_json, now_ms_,
               added.config, added.seeds);
  insert.exec();
  Accepted accepted{added.submission, db_.getLastInsertRowid(), {}};
  absl::Status status = Audit("evaluation", accepted.evaluation, "", "queued", who, "");
  int64_t next = blocks.front().first;
  for (const auto& [first, last] : blocks) {
    if (first != next || last < first) {
      return absl::InvalidArgumentError("leases must follow one another without gap or overlap");
    }
    next = last + 1;
    SQLite::Statement lease(db_, "INSERT INTO lease (evaluation, first, last, state) "
                                 "VALUES (?, ?, ?, 'pending')");
    SQLite::bind(lease, accepted.evaluation, first, last);
    lease.exec();
    accepted.leases.push_back(db_.getLastInsertRowid());
    status.Update(Audit("lease", accepted.leases.back(), "", "pending", who, ""));
  }
  if (!status.ok()) return status;
  return accepted;
}

absl::Status Writer::RunEvaluation(int64_t evaluation, const std::string& who) {
  SQLite::Statement update(db_, "UPDATE evaluation SET state = 'running', started_at = ? "
                                "WHERE id = ? AND state = 'queued'");
  SQLite::bind(update, now_ms_, evaluation);
  if (update.exec() == 0) return absl::OkStatus();  // already running
  return Audit("evaluation", evaluation, "queued", "running", who, "its first lease started");
}

absl::Status Writer::StartLease(int64_t lease, int64_t attempt, int64_t slot, int64_t deadline_ms,
                                const std::string& who) {
  ASSIGN_OR_RETURN(LeaseRow row, Lease(lease));
  if (row.state == LeaseState::kRunning && row.attempt == attempt) return absl::OkStatus();
  if (row.state != LeaseState::kPending || attempt != row.attempt + 1) {
    return Refuse("started", row, absl::StrCat(", not before attempt ", attempt));
  }
  SQLite::Statement update(db_,
                           "UPDATE lease SET state = 'running', attempt = ?, slot = ?, owner = ?, "
                           "started_at = ?, deadline_at = ? WHERE id = ?");
  SQLite::bind(update, attempt, slot, who, now_ms_, deadline_ms, lease);
  update.exec();
  absl::Status status = Audit("lease", lease, "pending", "running", who,
                              absl::StrCat("attempt ", attempt, " on slot ", slot));
  status.Update(RunEvaluation(row.evaluation, who));
  return status;
}

absl::StatusOr<Recorded> Writer::RecordEpisode(const EpisodeRow& row) {
  absl::StatusOr<LeaseRow> lease = Lease(row.lease);
  if (!lease.ok()) return lease.status();
  if (lease->state != LeaseState::kRunning || lease->attempt != row.attempt) {
    return Refuse("given an episode", *lease, absl::StrCat(", the episode is of ", row.attempt));
  }
  SQLite::Statement insert(db_,
                           "INSERT INTO episode VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?) "
                           "ON CONFLICT (evaluation, idx) DO NOTHING");
  SQLite::bind(insert, row.evaluation, row.index, row.lease, row.attempt,
               static_cast<int64_t>(row.seed), Text(OutcomeName(row.outcome)),
               Text(row.reason.name()), row.facts_json, row.metrics_json, now_ms_);
  if (insert.exec() == 1) {
    AddDetails(row);
    ChargeFirstEpisode(row.evaluation, absl::StrCat("episode ", row.index, " ended as ",
                                                    Text(OutcomeName(row.outcome))));
    return Recorded{.counted = true, .differs = {}};
  }

  SQLite::Statement select(db_, "SELECT outcome, reason, facts_json, metrics_json FROM episode "
                                "WHERE evaluation = ? AND idx = ?");
  SQLite::bind(select, row.evaluation, row.index);
  select.executeStep();
  StoredRow there(select, "episode", absl::StrCat(row.evaluation, "/", row.index));
  EpisodeRow kept = row;
  kept.outcome = there.Named(0, ParseOutcome);
  kept.reason = there.Named(1, ParseFailureReason);
  kept.facts_json = there.Object(2);
  kept.metrics_json = there.Object(3);
  if (!there.ok()) return there.status();
  Recorded recorded{.counted = false, .differs = DifferencesBetween(kept, row)};
  if (recorded.differs.empty()) return recorded;
  SQLite::Statement replay(db_,
                           "INSERT INTO replay (evaluation, idx, attempt, differs_json, "
                           "facts_json, recorded_at) VALUES (?, ?, ?, ?, ?, ?) "
                           "ON CONFLICT (evaluation, idx, attempt) DO NOTHING");
  SQLite::bind(replay, row.evaluation, row.index, row.attempt,
               CanonicalJson(nlohmann::json(recorded.differs)), row.facts_json, now_ms_);
  replay.exec();
  return recorded;
}

absl::Status Writer::FinishLease(int64_t lease, int64_t attempt, const std::string& output_json,
                                 const std::string& who) {
  ASSIGN_OR_RETURN(LeaseRow row, Lease(lease));
  if (row.state == LeaseState::kDone && row.attempt == attempt) return absl::OkStatus();
  if (row.state != LeaseState::kRunning || row.attempt != attempt) {
    return Refuse("finished", row, absl::StrCat(", not ", attempt));
  }
  SQLite::Statement count(db_, "SELECT count(*) FROM episode WHERE lease = ? AND evaluation = ? "
                               "AND idx BETWEEN ? AND ?");
  SQLite::bind(count, lease, row.evaluation, row.first, row.last);
  count.executeStep();
  if (count.getColumn(0).getInt64() != row.last - row.first + 1) {
    return Refuse("finished", row, ", and episodes are missing");
  }
  SQLite::Statement update(db_,
                           "UPDATE lease SET state = 'done', slot = NULL, owner = NULL, "
                           "started_at = NULL, deadline_at = NULL, finished_at = ?, "
                           "output_json = ? WHERE id = ?");
  SQLite::bind(update, now_ms_, output_json, lease);
  update.exec();
  return Audit("lease", lease, "running", "done", who, absl::StrCat("attempt ", attempt));
}

absl::Status Writer::ReturnLease(int64_t lease, int64_t attempt, bool fault,
                                 const std::string& who, const std::string& why) {
  ASSIGN_OR_RETURN(LeaseRow row, Lease(lease));
  if (row.state == LeaseState::kPending && row.attempt == attempt) return absl::OkStatus();
  if (row.state != LeaseState::kRunning || row.attempt != attempt) {
    return Refuse("returned", row, absl::StrCat(", not ", attempt));
  }
  SQLite::Statement update(db_,
                           "UPDATE lease SET state = 'pending', slot = NULL, owner = NULL, "
                           "started_at = NULL, deadline_at = NULL, faults = faults + ?, "
                           "detail = ? WHERE id = ?");
  SQLite::bind(update, fault ? 1 : 0, why, lease);
  update.exec();
  return Audit("lease", lease, "running", "pending", who, why);
}

absl::Status Writer::EndLease(int64_t lease, LeaseState state, bool fault, const std::string& who,
                              const std::string& why) {
  ASSIGN_OR_RETURN(LeaseRow row, Lease(lease));
  if (row.state == state) return absl::OkStatus();
  if (IsFinal(row.state) || (state != LeaseState::kFailed && state != LeaseState::kCancelled)) {
    return Refuse("ended", row, "");
  }
  SQLite::Statement update(db_,
                           "UPDATE lease SET state = ?, slot = NULL, owner = NULL, "
                           "started_at = NULL, deadline_at = NULL, finished_at = ?, "
                           "faults = faults + ?, detail = ? WHERE id = ?");
  SQLite::bind(update, Text(LeaseStateName(state)), now_ms_, fault ? 1 : 0, why, lease);
  update.exec();
  return Audit("lease", lease, LeaseStateName(row.state), LeaseStateName(state), who, why);
}

absl::Status Writer::NoteEvaluation(int64_t evaluation, const std::string& who,
                                    const std::string& why) {
  SQLite::Statement select(db_, "SELECT state FROM evaluation WHERE id = ?");
  select.bind(1, evaluation);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no evaluation ", evaluation));
  }
  const std::string state = select.getColumn(0).getString();
  return Audit("evaluation", evaluation, state, state, who, why);
}

absl::Status Writer::EndEvaluation(int64_t evaluation, EvaluationState state,
                                   const std::string& reason, const std::string& results_hash,
                                   const std::string& who) {
  SQLite::Statement select(db_, "SELECT state, (SELECT count(*) FROM lease WHERE evaluation = e.id "
                                "AND finished_at IS NULL) FROM evaluation AS e WHERE id = ?");
  select.bind(1, evaluation);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no evaluation ", evaluation));
  }
  StoredRow row(select, "evaluation", absl::StrCat(evaluation));
  const EvaluationState before = row.Named(0, ParseEvaluationState);
  if (!row.ok()) return row.status();
  if (before == state) return absl::OkStatus();
  if (!IsFinal(state) || IsFinal(before) || select.getColumn(1).getInt64() != 0) {
    return absl::FailedPreconditionError(absl::StrCat(
        "evaluation ", evaluation, " can't end as ", Text(EvaluationStateName(state)), ": it is ",
        Text(EvaluationStateName(before)), ", ", select.getColumn(1).getInt64(),
        " leases are open"));
  }
  MendBoardState();
  SQLite::Statement update(db_, "UPDATE evaluation SET state = ?, reason = ?, results_hash = ?, "
                                "finished_at = ? WHERE id = ?");
  SQLite::bind(update, Text(EvaluationStateName(state)), reason, results_hash, now_ms_, evaluation);
  update.exec();
  SettleCharge(evaluation, state, who);
  RETURN_IF_ERROR(AppendRecord(kGradedEntry, evaluation));
  TellEnd(evaluation, state);
  return Audit("evaluation", evaluation, EvaluationStateName(before), EvaluationStateName(state),
               who, reason);
}

}  // namespace myograde::server
