// The quota ledger; the rules are in quota.h.
#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/store/connection.h"
#include "server/store/reader.h"
#include "server/store/stored_row.h"
#include "server/store/store.h"
#include "server/store/teams.h"

namespace myograde::server {
namespace {

constexpr char kGrader[] = "daemon";

}  // namespace

void Writer::ChargeFirstEpisode(int64_t evaluation, const std::string& why) {
  SQLite::Statement insert(
      db_, "INSERT INTO ledger (at, day, team_id, track, phase, budget, entry, amount, "
           "submission, who, why) SELECT ?, a.day, a.team_id, a.track, a.phase, a.budget, 'charge', 1, a.submission, ?, ? "
           "FROM evaluation AS e JOIN admission AS a ON a.submission = e.submission "
           "WHERE e.id = ? AND e.kind = 'original' ON CONFLICT DO NOTHING");
  SQLite::bind(insert, now_ms_, kGrader, why, evaluation);
  insert.exec();
}

void Writer::ChargeBegun(int64_t evaluation) {
  SQLite::Statement begun(db_, "SELECT 1 FROM lease WHERE evaluation = ? AND attempt > 0 LIMIT 1");
  begun.bind(1, evaluation);
  if (begun.executeStep()) ChargeFirstEpisode(evaluation, "cancelled after its first lease had begun");
}

void Writer::SettleCharge(int64_t evaluation, EvaluationState state, const std::string& who) {
  const bool failed = state == EvaluationState::kFailed;
  if (!failed && state != EvaluationState::kGraderError) return;
  SQLite::Statement refund(
      db_, "INSERT INTO ledger (at, day, team_id, track, phase, budget, entry, amount, "
           "submission, who, why) SELECT ?, l.day, l.team_id, l.track, l.phase, l.budget, 'refund', l.amount, l.submission, "
           "?, ? FROM evaluation AS e JOIN ledger AS l ON l.submission = e.submission "
           "WHERE e.id = ? AND e.kind = 'original' AND l.entry = 'charge' AND l.budget != 'failed' "
           "ON CONFLICT DO NOTHING");
  SQLite::bind(refund, now_ms_, who,
               failed ? "every episode ended by the policy's fault: a failed try in its place"
                      : "the evaluation ended by the grader's fault",
               evaluation);
  refund.exec();
  if (!failed) return;
  SQLite::Statement charge(
      db_, "INSERT INTO ledger (at, day, team_id, track, phase, budget, entry, amount, "
           "submission, who, why) SELECT ?, a.day, a.team_id, a.track, a.phase, 'failed', 'charge', 1, a.submission, ?, ? "
           "FROM evaluation AS e JOIN admission AS a ON a.submission = e.submission "
           "WHERE e.id = ? AND e.kind = 'original' ON CONFLICT DO NOTHING");
  SQLite::bind(charge, now_ms_, who, "every episode ended by the policy's fault", evaluation);
  charge.exec();
}

absl::Status Writer::ChargeFailure(const std::string& team, const std::string& track,
                                   const std::string& who, const std::string& why) {
  ASSIGN_OR_RETURN(const std::string name, TeamNamed(db_, team));
  const int64_t id = AddTeam(db_, name, now_ms_, who);
  SQLite::Statement insert(
      db_, "INSERT INTO ledger (at, day, team_id, track, budget, entry, amount, who, why) "
           "VALUES (?, ?, ?, ?, 'failed', 'charge', 1, ?, ?)");
  SQLite::bind(insert, now_ms_, QuotaDay(db_, now_ms_), id, track, who, why);
  insert.exec();
  return absl::OkStatus();
}

absl::Status Writer::Grant(const NewGrant& grant, const std::string& who) {
  ASSIGN_OR_RETURN(const std::string name, TeamNamed(db_, grant.team));
  const int64_t id = AddTeam(db_, name, now_ms_, who);
  SQLite::Statement insert(
      db_, "INSERT INTO ledger (at, day, team_id, track, phase, budget, entry, amount, who, why) "
           "VALUES (?, ?, ?, ?, ?, ?, 'grant', ?, ?, ?)");
  SQLite::bind(insert, now_ms_, QuotaDay(db_, now_ms_), id, grant.track, grant.phase,
               std::string(BudgetName(grant.budget)), grant.amount, who, grant.why);
  insert.exec();
  return absl::OkStatus();
}

QuotaUse Reader::Quota(const std::string& team, const std::string& track, int64_t now_ms,
                       const std::string& phase) {
  return ReadQuotaUse(db_, team, track, phase, now_ms);
}

std::string Reader::ChargedBudget(int64_t submission) {
  SQLite::Statement select(
      db_, "SELECT budget FROM ledger WHERE submission = ? GROUP BY budget HAVING "
           "sum(CASE entry WHEN 'charge' THEN amount WHEN 'refund' THEN -amount ELSE 0 END) > 0 "
           "ORDER BY budget LIMIT 1");
  select.bind(1, submission);
  return select.executeStep() ? select.getColumn(0).getString() : "";
}

int64_t Reader::QuotaDayAt(int64_t now_ms) { return QuotaDay(db_, now_ms); }

namespace {

StoredRow LedgerRowOf(SQLite::Statement& select, LedgerRow& entry) {
  StoredRow row(select, "ledger", Shown(select.getColumn(0)));
  entry.id = row.Number(0, 1, INT64_MAX);
  entry.at = row.Time(1);
  entry.day = row.Number(2, 0, kLastDay);
  entry.track = row.Text(3);
  entry.budget = BudgetName(row.Named(4, ParseBudget));
  entry.entry = row.OneOf(5, {"charge", "refund", "grant"});
  entry.amount = row.Number(6, 1, kMostUnits);
  entry.submission = row.NumberOr(7, 1, INT64_MAX, 0);
  entry.who = row.Text(8);
  entry.why = row.Text(9);
  entry.phase = row.Text(10);
  return row;
}

}  // namespace

Listed<LedgerRow> Reader::Ledger(const std::string& team, const std::string& track,
                                 int64_t before, int64_t limit) {
  SQLite::Statement select(
      db_, absl::StrCat(
               "SELECT l.id, l.at, l.day, l.track, l.budget, l.entry, l.amount, l.submission, "
               "l.who, l.why, l.phase FROM ledger AS l WHERE l.team_id IN ", RowsOfTeam(1), " AND "
               "(?2 = '' OR l.track = ?2) AND l.id < ?3 ORDER BY l.id DESC LIMIT ?4"));
  SQLite::bind(select, KnownTeamId(db_, team), track, before, limit);
  LedgerRow empty;
  empty.team = team;
  return ListOf(select, empty, LedgerRowOf);
}

}  // namespace myograde::server
