#include "server/store/quota.h"

#include <algorithm>

#include <absl/strings/str_cat.h>
#include <absl/time/time.h>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/base/error_code.h"
#include "server/store/stored_row.h"
#include "server/store/teams.h"

namespace myograde::server {
namespace {

constexpr int64_t kDayMs = 24 * 60 * 60 * 1000;

// "1 ranked evaluation".
std::string CountedUnits(int64_t count, Budget budget) {
  if (budget == Budget::kFailed) return Counted(count, "failed try", "failed tries");
  return Counted(count, budget == Budget::kRanked ? "ranked evaluation" : "practice evaluation");
}

absl::Status Refuse(const std::string& sentence) { return CodedRefusal("quota", sentence); }

// What a quota is of, in sentences.
std::string Place(const std::string& track, const std::string& phase) {
  return phase.empty() ? absl::StrCat("track \"", track, "\"")
                       : absl::StrCat("phase \"", phase, "\"");
}

absl::Status CheckBudget(const QuotaUse& use, const QuotaLimits& limits, Budget budget,
                         const std::string& team, const std::string& place) {
  const Allowance& allowance = limits.of(budget);
  const std::string whose = absl::StrCat("team \"", team, "\" has used up its ");
  const auto rest = [&](const BudgetUse& sum, int64_t limit) {
    std::string text = absl::StrCat(CountedUnits(limit + sum.granted, budget), " of ", place);
    if (sum.open > 0) {
      absl::StrAppend(&text, " (", sum.open,
                      sum.open == 1 ? " of them waits or runs)" : " of them wait or run)");
    }
    return text;
  };
  if (const BudgetUse& sum = use.total_of(budget); sum.left(allowance.total) < 1) {
    return Refuse(absl::StrCat(whose, rest(sum, allowance.total),
                               " that it may have; only a grant of the organiser adds more"));
  }
  if (const BudgetUse& sum = use.today_of(budget); sum.left(allowance.per_day) < 1) {
    return Refuse(absl::StrCat(whose, rest(sum, allowance.per_day), " for ", DayName(use.day),
                               " (UTC); the next day begins at ", DayName(use.day + 1),
                               "T00:00:00Z"));
  }
  return absl::OkStatus();
}

constexpr char kAddLedgerRow[] =
    "INSERT INTO ledger (at, day, team_id, track, phase, budget, entry, amount, submission, who, "
    "why) ";

constexpr char kOwnBudget[] = "iif(s.ranked, 'official', 'practice')";  // of a submission `s`

// Charges a unit for a submission's own evaluation, unless that was done. `budget`: in SQL.
void Charge(SQLite::Database& db, int64_t now_ms, int64_t evaluation, const char* budget,
            const std::string& who, const std::string& why) {
  Run(db,
      absl::StrCat(kAddLedgerRow, "SELECT ?, s.day, s.team_id, s.track, s.phase, ", budget,
                   ", 'charge', 1, s.id, ?, ? FROM evaluation AS e "
                   "JOIN submission AS s ON s.id = e.submission "
                   "WHERE e.id = ? AND e.kind = 'original' ON CONFLICT DO NOTHING"),
      now_ms, who, why, evaluation);
}

constexpr StoredRows<LedgerRow, 11> kLedger = {
    "ledger",
    "SELECT id, at, day, track, phase, budget, entry, amount, ifnull(submission, 0), who, why "
    "FROM ledger "};

}  // namespace

std::string DayName(int64_t day) {
  return absl::FormatTime("%Y-%m-%d", absl::FromUnixMillis(day * kDayMs), absl::UTCTimeZone());
}

absl::Status CheckQuota(const QuotaUse& use, const QuotaLimits& limits, Budget budget,
                        const std::string& team, const std::string& track,
                        const std::string& phase) {
  const std::string place = Place(track, phase);
  if (use.waiting >= limits.waiting) {
    return Refuse(absl::StrCat("team \"", team, "\" has ", Counted(use.waiting, "evaluation"),
                               " of ", place, " waiting, and ", limits.waiting,
                               " may wait; submit more when one of them has started"));
  }
  RETURN_IF_ERROR(CheckBudget(use, limits, budget, team, place));
  return CheckBudget(use, limits, Budget::kFailed, team, place);
}

absl::Status CheckFailures(const QuotaUse& use, const QuotaLimits& limits, const std::string& team,
                           const std::string& track) {
  return CheckBudget(use, limits, Budget::kFailed, team, Place(track, ""));
}

void Quotas::ChargeFirstEpisode(int64_t evaluation, const std::string& why) {
  Charge(db_, now_ms_, evaluation, kOwnBudget, "daemon", why);
}

void Quotas::ChargeBegun(int64_t evaluation) {
  if (AnyRow(db_, "SELECT 1 FROM block WHERE evaluation = ? AND attempt > 0 LIMIT 1", evaluation)) {
    ChargeFirstEpisode(evaluation, "cancelled after its first block had begun");
  }
}

void Quotas::Settle(int64_t evaluation, EvaluationState state, const std::string& who) {
  const bool failed = state == EvaluationState::kFailed;
  if (!failed && state != EvaluationState::kGraderError) return;
  Run(db_,
      absl::StrCat(kAddLedgerRow,
                   "SELECT ?, l.day, l.team_id, l.track, l.phase, l.budget, 'refund', l.amount, "
                   "l.submission, ?, ? FROM evaluation AS e "
                   "JOIN ledger AS l ON l.submission = e.submission WHERE e.id = ? AND "
                   "e.kind = 'original' AND l.entry = 'charge' AND l.budget != 'failed' "
                   "ON CONFLICT DO NOTHING"),
      now_ms_, who,
      failed ? "every episode ended by the policy's fault: a failed try in its place"
             : "the evaluation ended by the grader's fault",
      evaluation);
  if (!failed) return;
  Charge(db_, now_ms_, evaluation, "'failed'", who, "every episode ended by the policy's fault");
}

absl::Status Quotas::AddUnits(const char* entry, const NewGrant& units, const std::string& who) {
  ASSIGN_OR_RETURN(const TeamInForce allowed, Teams(context_).Allowed(units.team));
  const int64_t team = Teams(context_).Ensure(allowed, who);
  Run(db_, absl::StrCat(kAddLedgerRow, "VALUES (?, ?, ?, ?, ?, ?, ?, ?, NULL, ?, ?)"), now_ms_,
      DayAt(now_ms_), team, units.track, units.phase, EnumName(units.budget), entry, units.amount,
      who, units.why);
  return absl::OkStatus();
}

absl::Status Quotas::ChargeFailure(const std::string& team, const std::string& track,
                                   const std::string& who, const std::string& why) {
  return AddUnits(
      "charge",
      {.team = team, .track = track, .budget = Budget::kFailed, .amount = 1, .why = why}, who);
}

absl::Status Quotas::Grant(const NewGrant& grant, const std::string& who) {
  return AddUnits("grant", grant, who);
}

QuotaUse Quotas::CountQuotaUse(const std::string& team, const std::string& track, int64_t now_ms,
                               const std::string& phase) const {
  QuotaUse use;
  use.day = DayAt(now_ms);
  // What the ledger has, and what was accepted and has neither ended nor been charged; nothing that
  // waits has been. Unreadable entries count for nothing; the ledger reports them.
  Statement select(
      db_,
      absl::StrCat("SELECT budget, entry, sum(amount), sum(amount * (day = ?1)) FROM ("
                   "SELECT budget, entry, amount, day FROM ledger WHERE team_id IN ",
                   RowsOfTeam(2),
                   " AND track = ?3 AND phase = ?4 AND typeof(amount) = 'integer' "
                   "AND amount BETWEEN 1 AND ?5 UNION ALL "
                   "SELECT ", kOwnBudget, ", iif(e.state = 'queued', 'waiting', 'open'), 1, s.day "
                   "FROM submission AS s JOIN evaluation AS e ON e.submission = s.id "
                   "AND e.kind = 'original' WHERE s.team_id IN ",
                   RowsOfTeam(2),
                   " AND s.track = ?3 AND s.phase = ?4 AND e.finished_at IS NULL "
                   "AND NOT EXISTS (SELECT 1 FROM ledger AS l WHERE l.submission = s.id "
                   "AND l.entry = 'charge')) GROUP BY budget, entry"),
      use.day, Teams(context_).IdOf(team), track, phase, kMostUnits);
  while (select.executeStep()) {
    const std::optional<Budget> budget = ParseEnum<Budget>(select.getColumn(0).getString());
    const std::string entry = select.getColumn(1).getString();
    if (entry == "waiting") use.waiting += select.getColumn(2).getInt64();
    if (!budget) continue;
    for (const auto& [sums, column] : {std::pair{&use.total, 2}, std::pair{&use.today, 3}}) {
      BudgetUse& sum = (*sums)[static_cast<size_t>(*budget)];
      const int64_t amount = select.getColumn(column).getInt64();
      if (entry == "grant") sum.granted += amount;
      if (entry == "charge") sum.charged += amount;
      if (entry == "refund") sum.charged -= amount;
      if (entry == "open" || entry == "waiting") sum.open += amount;
    }
  }
  return use;
}

std::string Quotas::ChargedBudget(int64_t submission) const {
  return FirstValue<std::string>(db_, R"(SELECT budget FROM ledger WHERE submission = ?
      GROUP BY budget
      HAVING sum(CASE entry WHEN 'charge' THEN amount WHEN 'refund' THEN -amount ELSE 0 END) > 0
      ORDER BY budget LIMIT 1)",
                                 submission);
}

int64_t Quotas::DayAt(int64_t now_ms) const {
  // Rows of a clock that was far ahead must not hold the day there until the calendar arrives.
  const int64_t today = now_ms / kDayMs;
  const int64_t newest = FirstValue<int64_t>(db_, R"(
      SELECT max(ifnull((SELECT max(day) FROM submission WHERE day <= ?1), 0),
      ifnull((SELECT max(day) FROM ledger WHERE day <= ?1), 0)))",
                                             std::min(today + 1, kLastDay));
  return std::max(newest, today);
}

Listed<LedgerRow> Quotas::Ledger(const std::string& team, const std::string& track, int64_t before,
                                 int64_t limit) const {
  return kLedger.List(db_,
                      absl::StrCat("WHERE team_id IN ", RowsOfTeam(1),
                                   " AND (?2 = '' OR track = ?2) AND id < ?3 "
                                   "ORDER BY id DESC LIMIT ?4"),
                      Teams(context_).IdOf(team), track, before, limit);
}

}  // namespace myograde::server
