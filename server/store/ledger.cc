// The ledger of quotas; quota.h has the rules.
#include <absl/strings/str_cat.h>

#include "server/store/connection.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/teams.h"

namespace myograde::server {
namespace {

constexpr char kGrader[] = "daemon";

}  // namespace

void Writer::ChargeFirstEpisode(int64_t evaluation, const std::string& why) {
  SQLite::Statement insert(
      db_, "INSERT INTO ledger (at, day, team_id, track, budget, entry, amount, submission, who, "
           "why) SELECT ?, a.day, a.team_id, a.track, a.budget, 'charge', 1, a.submission, ?, ? "
           "FROM evaluation AS e JOIN admission AS a ON a.submission = e.submission "
           "WHERE e.id = ? AND e.kind = 'original' ON CONFLICT DO NOTHING");
  SQLite::bind(insert, now_ms_, kGrader, why, evaluation);
  insert.exec();
}

void Writer::SettleCharge(int64_t evaluation, EvaluationState state, const std::string& who) {
  const bool failed = state == EvaluationState::kFailed;
  if (!failed && state != EvaluationState::kGraderError) return;
  SQLite::Statement refund(
      db_, "INSERT INTO ledger (at, day, team_id, track, budget, entry, amount, submission, who, "
           "why) SELECT ?, l.day, l.team_id, l.track, l.budget, 'refund', l.amount, l.submission, "
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
      db_, "INSERT INTO ledger (at, day, team_id, track, budget, entry, amount, submission, who, "
           "why) SELECT ?, a.day, a.team_id, a.track, 'failed', 'charge', 1, a.submission, ?, ? "
           "FROM evaluation AS e JOIN admission AS a ON a.submission = e.submission "
           "WHERE e.id = ? AND e.kind = 'original' ON CONFLICT DO NOTHING");
  SQLite::bind(charge, now_ms_, who, "every episode ended by the policy's fault", evaluation);
  charge.exec();
}

absl::Status Writer::ChargeFailure(const std::string& team, const std::string& track,
                                   const std::string& who, const std::string& why) {
  const absl::StatusOr<std::string> name = TeamNamed(db_, team);
  if (!name.ok()) return name.status();
  AddTeam(db_, *name, now_ms_);
  SQLite::Statement insert(
      db_, "INSERT INTO ledger (at, day, team_id, track, budget, entry, amount, who, why) "
           "VALUES (?, ?, (SELECT id FROM team WHERE name = ?), ?, 'failed', 'charge', 1, ?, ?)");
  SQLite::bind(insert, now_ms_, QuotaDay(db_, now_ms_), *name, track, who, why);
  insert.exec();
  return absl::OkStatus();
}

absl::Status Writer::Grant(const NewGrant& grant, const std::string& who) {
  const absl::StatusOr<std::string> name = TeamNamed(db_, grant.team);
  if (!name.ok()) return name.status();
  AddTeam(db_, *name, now_ms_);
  SQLite::Statement insert(
      db_, "INSERT INTO ledger (at, day, team_id, track, budget, entry, amount, who, why) "
           "VALUES (?, ?, (SELECT id FROM team WHERE name = ?), ?, ?, 'grant', ?, ?, ?)");
  SQLite::bind(insert, now_ms_, QuotaDay(db_, now_ms_), *name, grant.track,
               std::string(BudgetName(grant.budget)), grant.amount, who, grant.why);
  insert.exec();
  return absl::OkStatus();
}

QuotaUse Reader::Quota(const std::string& team, const std::string& track, int64_t now_ms) {
  return ReadQuotaUse(db_, team, track, now_ms);
}

int64_t Reader::QuotaDayAt(int64_t now_ms) { return QuotaDay(db_, now_ms); }

std::vector<LedgerRow> Reader::Ledger(const std::string& team, const std::string& track,
                                      int64_t before, int64_t limit) {
  SQLite::Statement select(
      db_, "SELECT l.id, l.at, l.day, l.track, l.budget, l.entry, l.amount, l.submission, l.who, "
           "l.why FROM ledger AS l WHERE l.team_id = (SELECT id FROM team WHERE name = ?1) AND "
           "(?2 = '' OR l.track = ?2) AND l.id < ?3 ORDER BY l.id DESC LIMIT ?4");
  SQLite::bind(select, team, track, before, limit);
  std::vector<LedgerRow> rows;
  while (select.executeStep()) {
    LedgerRow row;
    row.id = select.getColumn(0).getInt64();
    row.at = select.getColumn(1).getInt64();
    row.day = select.getColumn(2).getInt64();
    row.team = team;
    row.track = select.getColumn(3).getString();
    row.budget = select.getColumn(4).getString();
    row.entry = select.getColumn(5).getString();
    row.amount = select.getColumn(6).getInt64();
    row.submission = select.getColumn(7).getInt64();  // NULL reads as 0
    row.who = select.getColumn(8).getString();
    row.why = select.getColumn(9).getString();
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace myograde::server
