// The operations of a change on evaluations, leases and episodes. SQLite exceptions propagate to
// Store::Write.
#include <utility>

#include <SQLiteCpp/SQLiteCpp.h>
#include <SQLiteCpp/VariadicBind.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"
#include "protocol/tracks/registry.h"
#include "server/store/differences.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

absl::Status Refuse(const char* what, const LeaseRow& lease, std::string_view step) {
  return absl::FailedPreconditionError(absl::StrCat(
      "lease ", lease.id, " can't be ", what, ": it is ", std::string(LeaseStateName(lease.state)),
      ", attempt ", lease.attempt, std::string(step)));
}

constexpr char kOpenLeases[] =
    "SELECT id FROM lease WHERE evaluation = ? AND finished_at IS NULL ORDER BY first";

// The schema rejects any update of a row that has a value of a wrong type in any column.
void MendTypes(SQLite::Database& db, const char* table, int64_t id) {
  Statement columns(db, "SELECT name, type FROM pragma_table_info(?) WHERE pk = 0", table);
  std::vector<std::string> set;
  while (columns.executeStep()) {
    const std::string name = columns.getColumn(0).getString();
    const bool number = columns.getColumn(1).getString() == "INTEGER";
    set.push_back(absl::StrCat(name, " = CASE WHEN typeof(", name, ") IN ('null', '",
                               number ? "integer" : "text", "') THEN ", name, " ELSE ",
                               number ? "0" : "''", " END"));
  }
  Run(db, absl::StrCat("UPDATE ", table, " SET ", absl::StrJoin(set, ", "), " WHERE id = ?"), id);
}

}  // namespace

absl::Status Writer::Audit(const char* entity, int64_t id, std::string_view from,
                           std::string_view to, const std::string& who, const std::string& why) {
  Run(db_, R"(INSERT INTO transition (at, entity, entity_id, from_state, to_state, who, why)
      VALUES (?, ?, ?, ?, ?, ?, ?))",
      now_ms_, entity, id, from, to, who, why);
  return absl::OkStatus();
}

absl::StatusOr<LeaseRow> Writer::Lease(int64_t lease) {
  Statement select(
      db_, "SELECT id, evaluation, first, last, state, attempt, faults FROM lease WHERE id = ?",
      lease);
  const auto parse = [](SQLite::Statement& read, LeaseRow& found) {
    StoredRow row(read, "lease");
    found.id = row.Id(0);
    found.evaluation = row.Id(1);
    found.first = row.Number(2, 0, kMaxEpisodes - 1);
    found.last = row.Number(3, found.first, kMaxEpisodes - 1);
    found.state = row.Named(4, ParseLeaseState);
    found.attempt = row.Number(5, 0, INT64_MAX - 1);
    found.faults = row.Number(6, 0, found.attempt);
    return row;
  };
  return FirstOf<LeaseRow>(std::move(select), parse,
                           absl::NotFoundError(absl::StrCat("there is no lease ", lease)));
}

absl::StatusOr<Accepted> Writer::AddRerun(const NewRerun& rerun, const std::string& who) {
  return AddEvaluation({.submission = rerun.submission,
                        .kind = EvaluationKind::kRerun,
                        .grader_json = rerun.grader_json,
                        .blocks = rerun.blocks},
                       who);
}

absl::StatusOr<Accepted> Writer::AddEvaluation(const NewEvaluation& added, const std::string& who) {
  const std::vector<std::pair<int64_t, int64_t>>& blocks = added.blocks;
  if (blocks.empty()) return absl::InvalidArgumentError("an evaluation needs at least one lease");
  Run(db_, R"(INSERT INTO evaluation (submission, kind, first, last, state, grader_json, created_at,
      config, seeds, rejudge, repetition, source, method) VALUES (?, ?, ?, ?, 'queued', ?, ?,
      nullif(?, ''), nullif(?, ''), nullif(?, 0), nullif(?, 0), nullif(?, 0), nullif(?, '')))",
      added.submission, EvaluationKindName(added.kind), blocks.front().first, blocks.back().second,
      added.grader_json, now_ms_, added.config, added.seeds, added.rejudge, added.repetition,
      added.source, added.rejudge == 0 ? "" : RejudgeMethodName(added.method));
  Accepted accepted{added.submission, db_.getLastInsertRowid(), {}};
  RETURN_IF_ERROR(Audit("evaluation", accepted.evaluation, "", "queued", who, ""));
  int64_t next = blocks.front().first;
  for (const auto& [first, last] : blocks) {
    if (first != next || last < first) {
      return absl::InvalidArgumentError("leases must follow one another without gap or overlap");
    }
    next = last + 1;
    Run(db_, R"(INSERT INTO lease (evaluation, first, last, state) VALUES (?, ?, ?, 'pending'))",
        accepted.evaluation, first, last);
    accepted.leases.push_back(db_.getLastInsertRowid());
    RETURN_IF_ERROR(Audit("lease", accepted.leases.back(), "", "pending", who, ""));
  }
  return accepted;
}

absl::Status Writer::RunEvaluation(int64_t evaluation, const std::string& who) {
  Statement update(db_, R"(UPDATE evaluation
      SET state = 'running', started_at = ? WHERE id = ? AND state = 'queued')",
                   now_ms_, evaluation);
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
  Run(db_, R"(UPDATE lease SET state = 'running',
      attempt = ?, slot = ?, owner = ?, started_at = ?, deadline_at = ? WHERE id = ?)",
      attempt, slot, who, now_ms_, deadline_ms, lease);
  RETURN_IF_ERROR(Audit("lease", lease, "pending", "running", who,
                        absl::StrCat("attempt ", attempt, " on slot ", slot)));
  return RunEvaluation(row.evaluation, who);
}

absl::StatusOr<Recorded> Writer::RecordEpisode(const EpisodeRow& row) {
  ASSIGN_OR_RETURN(const LeaseRow lease, Lease(row.lease));
  if (lease.state != LeaseState::kRunning || lease.attempt != row.attempt) {
    return Refuse("given an episode", lease, absl::StrCat(", the episode is of ", row.attempt));
  }
  if (Run(db_, R"(INSERT INTO episode
      VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (evaluation, idx) DO NOTHING)",
          row.evaluation, row.index, row.lease, row.attempt, static_cast<int64_t>(row.seed),
          OutcomeName(row.outcome), row.reason.name(), row.facts_json, row.metrics_json,
          now_ms_) == 1) {
    if (!row.details_json.empty()) {
      Run(db_, "INSERT INTO episode_details (evaluation, idx, details_json) VALUES (?, ?, ?)",
          row.evaluation, row.index, row.details_json);
    }
    ChargeFirstEpisode(row.evaluation, absl::StrCat("episode ", row.index, " ended as ",
                                                    std::string(OutcomeName(row.outcome))));
    return Recorded{.counted = true, .differs = {}};
  }

  Statement select(db_, R"(SELECT outcome, reason, facts_json, metrics_json
      FROM episode WHERE evaluation = ? AND idx = ?)",
                   row.evaluation, row.index);
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
  Run(db_, R"(INSERT INTO replay (evaluation, idx, attempt, differs_json, facts_json, recorded_at)
      VALUES (?, ?, ?, ?, ?, ?) ON CONFLICT (evaluation, idx, attempt) DO NOTHING)",
      row.evaluation, row.index, row.attempt, CanonicalJson(nlohmann::json(recorded.differs)),
      row.facts_json, now_ms_);
  return recorded;
}

absl::Status Writer::FinishLease(int64_t lease, int64_t attempt, const std::string& output_json,
                                 const std::string& who) {
  ASSIGN_OR_RETURN(LeaseRow row, Lease(lease));
  if (row.state == LeaseState::kDone && row.attempt == attempt) return absl::OkStatus();
  if (row.state != LeaseState::kRunning || row.attempt != attempt) {
    return Refuse("finished", row, absl::StrCat(", not ", attempt));
  }
  const int64_t episodes = FirstNumber(db_, R"(SELECT count(*)
      FROM episode WHERE lease = ? AND evaluation = ? AND idx BETWEEN ? AND ?)",
                                       lease, row.evaluation, row.first, row.last);
  if (episodes != row.last - row.first + 1) {
    return Refuse("finished", row, ", and episodes are missing");
  }
  Run(db_, R"(UPDATE lease SET state = 'done', slot = NULL, owner = NULL,
      started_at = NULL, deadline_at = NULL, finished_at = ?, output_json = ? WHERE id = ?)",
      now_ms_, output_json, lease);
  return Audit("lease", lease, "running", "done", who, absl::StrCat("attempt ", attempt));
}

absl::Status Writer::ReturnLease(int64_t lease, int64_t attempt, bool fault, const std::string& who,
                                 const std::string& why) {
  ASSIGN_OR_RETURN(LeaseRow row, Lease(lease));
  if (row.state == LeaseState::kPending && row.attempt == attempt) return absl::OkStatus();
  if (row.state != LeaseState::kRunning || row.attempt != attempt) {
    return Refuse("returned", row, absl::StrCat(", not ", attempt));
  }
  Run(db_, R"(UPDATE lease SET state = 'pending', slot = NULL, owner = NULL,
      started_at = NULL, deadline_at = NULL, faults = faults + ?, detail = ? WHERE id = ?)",
      fault, why, lease);
  return Audit("lease", lease, "running", "pending", who, why);
}

absl::Status Writer::EndLease(int64_t lease, LeaseState state, bool fault, const std::string& who,
                              const std::string& why) {
  ASSIGN_OR_RETURN(LeaseRow row, Lease(lease));
  if (row.state == state) return absl::OkStatus();
  if (IsFinal(row.state) || (state != LeaseState::kFailed && state != LeaseState::kCancelled)) {
    return Refuse("ended", row, "");
  }
  Run(db_, R"(UPDATE lease SET state = ?, slot = NULL, owner = NULL, started_at = NULL,
      deadline_at = NULL, finished_at = ?, faults = faults + ?, detail = ? WHERE id = ?)",
      LeaseStateName(state), now_ms_, fault, why, lease);
  return Audit("lease", lease, LeaseStateName(row.state), LeaseStateName(state), who, why);
}

absl::Status Writer::NoteEvaluation(int64_t evaluation, const std::string& who,
                                    const std::string& why) {
  Statement select(db_, "SELECT state FROM evaluation WHERE id = ?", evaluation);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no evaluation ", evaluation));
  }
  const std::string state = select.getColumn(0).getString();
  return Audit("evaluation", evaluation, state, state, who, why);
}

absl::Status Writer::EndEvaluation(int64_t evaluation, EvaluationState state,
                                   const std::string& reason, const std::string& results_hash,
                                   const std::string& who) {
  Statement select(db_, R"(SELECT state, (SELECT count(*) FROM lease
      WHERE evaluation = e.id AND finished_at IS NULL) FROM evaluation AS e WHERE id = ?)",
                   evaluation);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no evaluation ", evaluation));
  }
  StoredRow row(select, "evaluation", absl::StrCat(evaluation));
  const EvaluationState before = row.Named(0, ParseEvaluationState);
  if (!row.ok()) return row.status();
  if (before == state) return absl::OkStatus();
  if (!IsFinal(state) || IsFinal(before) || select.getColumn(1).getInt64() != 0) {
    return absl::FailedPreconditionError(absl::StrCat(
        "evaluation ", evaluation, " can't end as ", std::string(EvaluationStateName(state)),
        ": it is ", std::string(EvaluationStateName(before)), ", ", select.getColumn(1).getInt64(),
        " leases are open"));
  }
  Run(db_, R"(UPDATE evaluation
      SET state = ?, reason = ?, results_hash = ?, finished_at = ? WHERE id = ?)",
      EvaluationStateName(state), reason, results_hash, now_ms_, evaluation);
  SettleCharge(evaluation, state, who);
  AppendGraded(evaluation, who);
  TellEnd(evaluation, state);
  return Audit("evaluation", evaluation, EvaluationStateName(before), EvaluationStateName(state),
               who, reason);
}

// Practice and re-runs have no act.
void Writer::AppendGraded(int64_t evaluation, const std::string& who) {
  Statement select(db_, R"(SELECT e.submission, e.state, e.results_hash, ifnull(e.config, s.config),
      ifnull(e.seeds, s.seeds), e.grader_json, e.rejudge, e.repetition FROM evaluation AS e
      JOIN submission AS s ON s.id = e.submission
      WHERE e.id = ? AND s.ranked = 1 AND e.kind != 'rerun')",
                   evaluation);
  if (!select.executeStep()) return;
  const std::string state = select.getColumn(1).getString();
  const bool failed = state == EvaluationStateName(EvaluationState::kFailed);
  const bool result = failed || state == EvaluationStateName(EvaluationState::kDone);
  // The hash of the build as a receipt shows it.
  const std::string grader = Sha256Hex(CanonicalJson(nlohmann::json::parse(
      select.getColumn(5).getString(), nullptr, /*allow_exceptions=*/false)));
  Append({.kind = kGradedAct,
          .who = who,
          .content = {{"evaluation", evaluation},
                      {"submission", select.getColumn(0).getInt64()},
                      {"state", result ? "graded" : state},
                      {"results", result ? nlohmann::json(select.getColumn(2).getString()) : nullptr},
                      {"config", select.getColumn(3).getString()},
                      {"seeds", select.getColumn(4).getString()},
                      {"grader", grader},
                      {"rejudge", OrNull(select.getColumn(6).getInt64())},
                      {"repetition", OrNull(select.getColumn(7).getInt64())}},
          .beside = failed ? nlohmann::json{{"failed", true}} : nlohmann::json::object(),
          .evaluation = evaluation});
}

std::vector<int64_t> Writer::OpenEvaluationsOf(int64_t submission, bool reruns) {
  const char* kinds = reruns ? "('original', 'rerun')" : "('original')";
  return AllNumbers(db_,
                    absl::StrCat("SELECT id FROM evaluation WHERE submission = ?1 AND kind IN ",
                                 kinds, " AND finished_at IS NULL ORDER BY id"),
                    submission);
}

absl::Status Writer::EndWithLeases(int64_t evaluation, EvaluationState state,
                                   const std::string& why, const std::string& who) {
  for (const int64_t lease : AllNumbers(db_, kOpenLeases, evaluation)) {
    RETURN_IF_ERROR(EndLease(lease, LeaseState::kCancelled, /*fault=*/false, who, why));
  }
  return EndEvaluation(evaluation, state, why, "", who);
}

absl::Status Writer::EndUnreadable(int64_t evaluation, const std::string& why,
                                   const std::string& who) {
  const absl::Status whole = Part([&](Writer& writer) {
    return writer.EndWithLeases(evaluation, EvaluationState::kGraderError, why, who);
  });
  if (whole.ok()) return whole;
  Statement select(db_, "SELECT state FROM evaluation WHERE id = ?", evaluation);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no evaluation ", evaluation));
  }
  StoredRow row(select, "evaluation", absl::StrCat(evaluation));
  const std::string before(EvaluationStateName(row.Named(0, ParseEvaluationState)));
  select.reset();
  // From here on each step is its own part: a rejected one must not stop the others.
  const auto part = [&](auto change) {
    return Part([&](Writer&) -> absl::Status {
      change();
      return absl::OkStatus();
    });
  };
  for (const int64_t lease : AllNumbers(db_, kOpenLeases, evaluation)) {
    const absl::Status usual = Part([&](Writer& writer) {
      return writer.EndLease(lease, LeaseState::kCancelled, /*fault=*/false, who, why);
    });
    if (usual.ok()) continue;
    (void)part([&] { MendTypes(db_, "lease", lease); });
    (void)Part([&](Writer& writer) -> absl::Status {
      Run(db_, R"(UPDATE lease SET state = 'cancelled', slot = NULL, owner = NULL,
          started_at = NULL, deadline_at = NULL, finished_at = ?, detail = ? WHERE id = ?)",
          now_ms_, why, lease);
      return writer.Audit("lease", lease, "", "cancelled", who, why);
    });
  }
  (void)part([&] { MendTypes(db_, "evaluation", evaluation); });
  RETURN_IF_ERROR(part([&] {
    Run(db_, R"(UPDATE evaluation
        SET state = 'grader_error', reason = ?, finished_at = ? WHERE id = ?)",
        why, now_ms_, evaluation);
  }));
  (void)part([&] { SettleCharge(evaluation, EvaluationState::kGraderError, who); });
  (void)part([&] { AppendGraded(evaluation, who); });
  TellEnd(evaluation, EvaluationState::kGraderError);
  return Audit("evaluation", evaluation, before, "grader_error", who, why);
}

absl::StatusOr<std::map<int64_t, std::string>> Reader::EpisodeDetails(int64_t evaluation) {
  Statement select(
      db_, "SELECT id, idx, details_json FROM episode_details WHERE evaluation = ? ORDER BY idx",
      evaluation);
  std::map<int64_t, std::string> details;
  while (select.executeStep()) {
    StoredRow row(select, "episode_details");
    const int64_t index = row.Number(1, 0, INT64_MAX);
    std::string text = row.Object(2);
    if (!row.ok()) return row.status();
    details.emplace_hint(details.end(), index, std::move(text));
  }
  return details;
}

}  // namespace myograde::server
