// Ends evaluations with everything that belongs to them: cancelled ones, and those with unreadable
// rows.
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/status_macros.h"
#include "server/store/connection.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

std::vector<int64_t> Ids(SQLite::Database& db, const std::string& sql, int64_t value) {
  SQLite::Statement select(db, sql);
  select.bind(1, value);
  std::vector<int64_t> ids;
  while (select.executeStep()) ids.push_back(select.getColumn(0).getInt64());
  return ids;
}

constexpr char kOpenLeases[] =
    "SELECT id FROM lease WHERE evaluation = ? AND finished_at IS NULL ORDER BY first";

}  // namespace

std::vector<int64_t> Writer::OpenEvaluations() {
  return Ids(db_, "SELECT id FROM evaluation WHERE ?1 = 0 AND finished_at IS NULL ORDER BY id", 0);
}

std::vector<int64_t> Writer::OpenEvaluationsOf(int64_t submission, bool reruns) {
  const char* kinds = reruns ? "('original', 'rerun')" : "('original')";
  return Ids(db_, absl::StrCat("SELECT id FROM evaluation WHERE submission = ?1 AND kind IN ", kinds,
                               " AND finished_at IS NULL ORDER BY id"), submission);
}

absl::Status Writer::EndWithLeases(int64_t evaluation, EvaluationState state,
                                   const std::string& why, const std::string& who) {
  for (const int64_t lease : Ids(db_, kOpenLeases, evaluation)) {
    RETURN_IF_ERROR(EndLease(lease, LeaseState::kCancelled, /*fault=*/false, who, why));
  }
  return EndEvaluation(evaluation, state, why, "", who);
}

// The schema rejects any update of a row that has a value of a wrong type in any column.
void Writer::MendTypes(const char* table, int64_t id) {
  SQLite::Statement columns(db_, "SELECT name, type FROM pragma_table_info(?) WHERE pk = 0");
  columns.bind(1, table);
  std::vector<std::string> set;
  while (columns.executeStep()) {
    const std::string name = columns.getColumn(0).getString();
    const bool number = columns.getColumn(1).getString() == "INTEGER";
    set.push_back(absl::StrCat(name, " = CASE WHEN typeof(", name, ") IN ('null', '",
                               number ? "integer" : "text", "') THEN ", name, " ELSE ",
                               number ? "0" : "''", " END"));
  }
  SQLite::Statement update(
      db_, absl::StrCat("UPDATE ", table, " SET ", absl::StrJoin(set, ", "), " WHERE id = ?"));
  update.bind(1, id);
  update.exec();
}

absl::Status Writer::EndUnreadable(int64_t evaluation, const std::string& why,
                                   const std::string& who) {
  const absl::Status whole = Part([&](Writer& writer) {
    return writer.EndWithLeases(evaluation, EvaluationState::kGraderError, why, who);
  });
  if (whole.ok()) return whole;
  SQLite::Statement select(db_, "SELECT state FROM evaluation WHERE id = ?");
  select.bind(1, evaluation);
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
  for (const int64_t lease : Ids(db_, kOpenLeases, evaluation)) {
    const absl::Status usual = Part([&](Writer& writer) {
      return writer.EndLease(lease, LeaseState::kCancelled, /*fault=*/false, who, why);
    });
    if (usual.ok()) continue;
    (void)part([&] { MendTypes("lease", lease); });
    (void)Part([&](Writer& writer) -> absl::Status {
      SQLite::Statement update(
          db_,
          "UPDATE lease SET state = 'cancelled', slot = NULL, owner = NULL, started_at = NULL, "
          "deadline_at = NULL, finished_at = ?, detail = ? WHERE id = ?");
      SQLite::bind(update, now_ms_, why, lease);
      update.exec();
      return writer.Audit("lease", lease, "", "cancelled", who, why);
    });
  }
  (void)part([&] { MendTypes("evaluation", evaluation); });
  RETURN_IF_ERROR(part([&] {
    SQLite::Statement update(db_, "UPDATE evaluation SET state = 'grader_error', reason = ?, "
                                  "finished_at = ? WHERE id = ?");
    SQLite::bind(update, why, now_ms_, evaluation);
    update.exec();
  }));
  (void)part([&] { SettleCharge(evaluation, EvaluationState::kGraderError, who); });
  (void)Part([&](Writer& writer) { return writer.AppendRecord(kGradedEntry, evaluation); });
  TellEnd(evaluation, EvaluationState::kGraderError);
  return Audit("evaluation", evaluation, before, "grader_error", who, why);
}

}  // namespace myograde::server
