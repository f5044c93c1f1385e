#include "server/store/evaluations.h"

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/store/stored_row.h"
#include "server/store/transaction.h"

namespace myograde::server {
namespace {

constexpr char kOpenBlocks[] =
    "SELECT id FROM block WHERE evaluation = ? AND finished_at IS NULL ORDER BY first";

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

constexpr StoredRows<EvaluationRow, 17> kEvaluations = {
    .table = "evaluation",
    .select =
        "SELECT e.id, e.submission, e.kind, e.first, e.last, e.state, e.reason, e.grader_json, "
        "ifnull(e.results_hash, ''), ifnull(e.started_at, 0), ifnull(e.finished_at, 0), "
        "coalesce(e.config, s.config, ''), coalesce(e.seeds, s.seeds, ''), ifnull(e.rejudge, 0), "
        "ifnull(e.repetition, 0), ifnull(e.source, 0), ifnull(e.method, 'play') "
        "FROM evaluation AS e LEFT JOIN submission AS s ON s.id = e.submission ",
    .wrong = [](const EvaluationRow& evaluation) {
      if (evaluation.last < evaluation.first) return "its last episode comes before its first";
      return IsFinal(evaluation.state) == (evaluation.finished_at > 0)
                 ? ""
                 : "its \"state\" and its \"finished_at\" contradict each other";
    }};

constexpr StoredRows<TransitionRow, 6> kTransitions = {
    .table = "transition",
    .select = "SELECT id, at, entity, from_state, to_state, who, why FROM transition ",
    .first = 1};

}  // namespace

absl::StatusOr<EvaluationRow> Evaluations::Find(int64_t id) const {
  return kEvaluations.First(db_, NoSuch("evaluation", id), "WHERE e.id = ?", id);
}

absl::StatusOr<std::vector<EvaluationRow>> Evaluations::Of(int64_t submission) const {
  auto rows = kEvaluations.All(
      db_, "WHERE e.submission = ? ORDER BY e.kind != 'original', e.id", submission);
  if (rows.ok() && (rows->empty() || rows->front().kind != EvaluationKind::kOriginal)) {
    return DamagedRow({"submission", absl::StrCat(submission),
                       "it has no evaluation, or none that is its original one"});
  }
  return rows;
}

absl::StatusOr<std::vector<EvaluationRow>> Evaluations::OfRejudge(int64_t rejudge) const {
  return kEvaluations.All(db_, "WHERE e.rejudge = ? ORDER BY e.submission, e.repetition", rejudge);
}

absl::StatusOr<EvaluationRow> Evaluations::Original(int64_t submission) const {
  ASSIGN_OR_RETURN(std::vector<EvaluationRow> rows, Of(submission));
  return std::move(rows.front());
}

Listed<EvaluationRow> Evaluations::Unfinished() const {
  // Anything not in a final state has not ended, including rows with an invalid state.
  return kEvaluations.List(db_, R"(WHERE e.finished_at IS NULL
      OR (e.state IN ('done', 'failed', 'cancelled', 'grader_error')) IS NOT TRUE ORDER BY e.id)");
}

absl::StatusOr<std::vector<TransitionRow>> Evaluations::Transitions(const std::string& entity,
                                                                    int64_t id) const {
  return kTransitions.All(db_, "WHERE entity = ? AND entity_id = ? ORDER BY id", entity, id);
}

absl::StatusOr<Accepted> Evaluations::Add(const EvaluationRow& added, const EpisodeBlocks& blocks,
                                          const std::string& who) {
  if (blocks.empty()) return absl::InvalidArgumentError("an evaluation needs at least one block");
  Run(db_, R"(INSERT INTO evaluation (submission, kind, first, last, state, grader_json, created_at,
      config, seeds, rejudge, repetition, source, method) VALUES (?, ?, ?, ?, 'queued', ?, ?,
      nullif(?, ''), nullif(?, ''), nullif(?, 0), nullif(?, 0), nullif(?, 0), nullif(?, '')))",
      added.submission, EnumName(added.kind), blocks.front().first, blocks.back().second,
      added.grader_json, now_ms_, added.config, added.seeds, added.rejudge, added.repetition,
      added.source, added.rejudge == 0 ? "" : EnumName(added.method));
  Accepted accepted{added.submission, db_.getLastInsertRowid(), {}};
  RETURN_IF_ERROR(Audit("evaluation", accepted.evaluation, "", "queued", who, ""));
  int64_t next = blocks.front().first;
  for (const auto& [first, last] : blocks) {
    if (first != next || last < first) {
      return absl::InvalidArgumentError("blocks must follow one another without gap or overlap");
    }
    next = last + 1;
    Run(db_, R"(INSERT INTO block (evaluation, first, last, state) VALUES (?, ?, ?, 'pending'))",
        accepted.evaluation, first, last);
    accepted.blocks.push_back(db_.getLastInsertRowid());
    RETURN_IF_ERROR(Audit("block", accepted.blocks.back(), "", "pending", who, ""));
  }
  return accepted;
}

absl::Status Evaluations::Note(int64_t evaluation, const std::string& who, const std::string& why) {
  const auto [id, state] = FirstRow<int64_t, std::string>(
      db_, "SELECT id, state FROM evaluation WHERE id = ?", evaluation);
  if (id == 0) return NoSuch("evaluation", evaluation);
  return Audit("evaluation", evaluation, state, state, who, why);
}

absl::Status Evaluations::End(int64_t evaluation, EvaluationState state, const std::string& reason,
                              const std::string& results_hash, const std::string& who) {
  ASSIGN_OR_RETURN(const EvaluationRow row, Find(evaluation));
  if (row.state == state) return absl::OkStatus();
  const auto open = AllValues<int64_t>(db_, kOpenBlocks, evaluation);
  if (!IsFinal(state) || IsFinal(row.state) || !open.empty()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "evaluation ", evaluation, " can't end as ", std::string(EnumName(state)), ": it is ",
        std::string(EnumName(row.state)), ", ", open.size(), " blocks are open"));
  }
  Run(db_, R"(UPDATE evaluation
      SET state = ?, reason = ?, results_hash = ?, finished_at = ? WHERE id = ?)",
      EnumName(state), reason, results_hash, now_ms_, evaluation);
  Quotas(context_).Settle(evaluation, state, who);
  AppendGraded(evaluation, who);
  Deliveries(context_).TellEnd(evaluation, state);
  return Audit("evaluation", evaluation, EnumName(row.state), EnumName(state), who, reason);
}

void Evaluations::AppendGraded(int64_t evaluation, const std::string& who) {
  using Text = std::string;
  const auto [submission, state, results, config, seeds, build, rejudge, repetition] =
      FirstRow<int64_t, Text, Text, Text, Text, Text, int64_t, int64_t>(
          db_, R"(SELECT e.submission, e.state, e.results_hash,
      ifnull(e.config, s.config), ifnull(e.seeds, s.seeds), e.grader_json, e.rejudge, e.repetition
      FROM evaluation AS e JOIN submission AS s ON s.id = e.submission
      WHERE e.id = ? AND s.ranked = 1 AND e.kind != 'rerun')",
          evaluation);
  if (submission == 0) return;
  const bool failed = state == EnumName(EvaluationState::kFailed);
  const bool result = failed || state == EnumName(EvaluationState::kDone);
  // The hash of the build as a receipt shows it.
  const std::string grader = Sha256Hex(CanonicalJson(ParsedText(build)));
  Append({.kind = kGradedAct,
          .who = who,
          .content = {{"evaluation", evaluation},
                      {"submission", submission},
                      {"state", result ? "graded" : state},
                      {"results", result ? nlohmann::json(results) : nullptr},
                      {"config", config},
                      {"seeds", seeds},
                      {"grader", grader},
                      {"rejudge", IdOrNull(rejudge)},
                      {"repetition", IdOrNull(repetition)}},
          .beside = failed ? nlohmann::json{{"failed", true}} : nlohmann::json::object(),
          .evaluation = evaluation});
}

std::vector<int64_t> Evaluations::OpenOf(int64_t submission, bool reruns) {
  return AllValues<int64_t>(db_, R"(SELECT id FROM evaluation WHERE submission = ?1
      AND (kind = 'original' OR (?2 AND kind = 'rerun')) AND finished_at IS NULL ORDER BY id)",
                            submission, reruns);
}

absl::Status Evaluations::EndWithBlocks(int64_t evaluation, EvaluationState state,
                                        const std::string& why, const std::string& who) {
  for (const int64_t block : AllValues<int64_t>(db_, kOpenBlocks, evaluation)) {
    RETURN_IF_ERROR(Blocks(context_).End(block, BlockState::kCancelled, /*fault=*/false, who, why));
  }
  return End(evaluation, state, why, "", who);
}

absl::Status Evaluations::EndUnreadable(int64_t evaluation, const std::string& why,
                                        const std::string& who) {
  const absl::Status whole =
      Part([&] { return EndWithBlocks(evaluation, EvaluationState::kGraderError, why, who); });
  if (whole.ok()) return whole;
  const auto [id, state] = FirstRow<int64_t, std::string>(
      db_, "SELECT id, state FROM evaluation WHERE id = ?", evaluation);
  if (id == 0) return NoSuch("evaluation", evaluation);
  const EvaluationState before = ParseEnum<EvaluationState>(state).value_or(EvaluationState{});
  // From here on each step is its own part: a rejected one must not stop the others.
  const auto part = [&](auto change) {
    return Part([&] {
      change();
      return absl::OkStatus();
    });
  };
  for (const int64_t block : AllValues<int64_t>(db_, kOpenBlocks, evaluation)) {
    (void)part([&] { MendTypes(db_, "block", block); });
    (void)Part([&] {
      Run(db_, R"(UPDATE block SET state = 'cancelled', slot = NULL, owner = NULL,
          started_at = NULL, deadline_at = NULL, finished_at = ?, detail = ? WHERE id = ?)",
          now_ms_, why, block);
      return Audit("block", block, "", "cancelled", who, why);
    });
  }
  (void)part([&] { MendTypes(db_, "evaluation", evaluation); });
  RETURN_IF_ERROR(part([&] {
    Run(db_, R"(UPDATE evaluation
        SET state = 'grader_error', reason = ?, finished_at = ? WHERE id = ?)",
        why, now_ms_, evaluation);
  }));
  (void)part([&] { Quotas(context_).Settle(evaluation, EvaluationState::kGraderError, who); });
  (void)part([&] { AppendGraded(evaluation, who); });
  Deliveries(context_).TellEnd(evaluation, EvaluationState::kGraderError);
  return Audit("evaluation", evaluation, EnumName(before), "grader_error", who, why);
}

std::vector<int64_t> Evaluations::Done(bool without_standing) const {
  return AllValues<int64_t>(db_, R"(SELECT e.id
      FROM evaluation AS e LEFT JOIN standing AS v ON v.evaluation = e.id WHERE e.state = 'done'
      AND e.kind != 'rerun' AND (NOT ?1 OR v.evaluation IS NULL) ORDER BY e.id)",
                            without_standing);
}

std::vector<std::string> Evaluations::ListGraders(const std::vector<int64_t>& evaluations) const {
  std::vector<std::string> graders;
  for (const int64_t evaluation : evaluations) {
    graders.push_back(
        FirstValue<std::string>(db_, "SELECT grader_json FROM evaluation WHERE id = ?", evaluation));
  }
  return graders;
}

absl::StatusOr<std::string> Evaluations::TeamOf(int64_t id) const {
  const int64_t submission =
      FirstValue<int64_t>(db_, "SELECT submission FROM evaluation WHERE id = ?", id);
  if (submission != 0) return Submissions(context_).TeamOf(submission);
  return NoSuch("evaluation", id);
}

std::vector<int64_t> Evaluations::DoneSince(int64_t after_ms, int64_t limit) const {
  // A damaged row's time may be a text, which SQLite takes for later than any number.
  return AllValues<int64_t>(db_, R"(SELECT id FROM (SELECT id, finished_at FROM evaluation
      WHERE state = 'done' AND finished_at > ? AND typeof(finished_at) = 'integer'
      ORDER BY finished_at DESC, id DESC LIMIT ?) ORDER BY finished_at, id)",
                            after_ms, limit);
}

int64_t Evaluations::LastEnd() const {
  return FirstValue<int64_t>(db_, "SELECT max(finished_at) FROM evaluation");
}

}  // namespace myograde::server
