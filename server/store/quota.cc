#include "server/store/quota.h"

#include <algorithm>

#include <SQLiteCpp/SQLiteCpp.h>
#include <SQLiteCpp/VariadicBind.h>
#include <absl/strings/str_cat.h>
#include <absl/time/time.h>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/store/teams.h"

namespace myograde::server {
namespace {

constexpr int64_t kDayMs = 24 * 60 * 60 * 1000;
constexpr char kCodeKey[] = "myograde/error-code";

constexpr std::array<std::string_view, 3> kNames = {"official", "practice", "failed"};

size_t Index(Budget budget) { return static_cast<size_t>(budget); }

// "1 ranked evaluation".
std::string CountedUnits(int64_t count, Budget budget) {
  switch (budget) {
    case Budget::kRanked: return Counted(count, "ranked evaluation");
    case Budget::kPractice: return Counted(count, "practice evaluation");
    case Budget::kFailed: break;
  }
  return Counted(count, "failed try", "failed tries");
}

void AddLedger(SQLite::Database& db, int64_t team, const std::string& track,
               const std::string& phase, QuotaUse& use) {
  // Unreadable entries count for nothing; the ledger reports them.
  SQLite::Statement select(
      db, absl::StrCat("SELECT budget, entry, sum(amount), sum(amount * (day = ?1)) FROM ledger "
                       "WHERE team_id IN ", RowsOfTeam(2), " AND track = ?3 AND phase = ?5 AND "
                       "typeof(amount) = 'integer' AND amount BETWEEN 1 AND ?4 "
                       "GROUP BY budget, entry"));
  SQLite::bind(select, use.day, team, track, kMostUnits, phase);
  while (select.executeStep()) {
    const std::optional<Budget> budget = ParseBudget(select.getColumn(0).getString());
    if (!budget) continue;
    const std::string entry = select.getColumn(1).getString();
    for (const auto& [sums, column] : {std::pair{&use.total, 2}, std::pair{&use.today, 3}}) {
      BudgetUse& sum = (*sums)[Index(*budget)];
      const int64_t amount = select.getColumn(column).getInt64();
      if (entry == "grant") sum.granted += amount;
      if (entry == "charge") sum.charged += amount;
      if (entry == "refund") sum.charged -= amount;
    }
  }
}

void AddOpen(SQLite::Database& db, int64_t team, const std::string& track,
             const std::string& phase, QuotaUse& use) {
  SQLite::Statement select(
      db, absl::StrCat("SELECT a.budget, a.day = ?1, e.state = 'queued', EXISTS (SELECT 1 FROM "
                       "ledger AS l WHERE l.submission = a.submission AND l.entry = 'charge') "
                       "FROM admission AS a JOIN evaluation AS e ON e.submission = a.submission "
                       "AND e.kind = 'original' WHERE a.team_id IN ", RowsOfTeam(2),
                       " AND a.track = ?3 AND a.phase = ?4 AND e.finished_at IS NULL"));
  SQLite::bind(select, use.day, team, track, phase);
  while (select.executeStep()) {
    use.waiting += select.getColumn(2).getInt64();
    const std::optional<Budget> budget = ParseBudget(select.getColumn(0).getString());
    if (!budget || select.getColumn(3).getInt() != 0) continue;
    use.total[Index(*budget)].open += 1;
    use.today[Index(*budget)].open += select.getColumn(1).getInt64();
  }
}

absl::Status Refuse(const std::string& sentence) {
  return WithErrorCode(absl::FailedPreconditionError(sentence), "quota");
}

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

}  // namespace

std::string_view BudgetName(Budget budget) { return kNames[Index(budget)]; }

std::optional<Budget> ParseBudget(std::string_view name) {
  for (const Budget budget : kBudgets) {
    if (BudgetName(budget) == name) return budget;
  }
  return std::nullopt;
}

const Allowance& QuotaLimits::of(Budget budget) const {
  if (budget == Budget::kRanked) return ranked;
  return budget == Budget::kPractice ? practice : failed;
}

int64_t QuotaDay(SQLite::Database& db, int64_t now_ms) {
  // Rows of a clock that was far ahead must not hold the day there until the calendar arrives.
  const int64_t today = now_ms / kDayMs;
  SQLite::Statement select(db,
                           "SELECT max(ifnull((SELECT max(day) FROM admission WHERE day <= ?1), "
                           "0), ifnull((SELECT max(day) FROM ledger WHERE day <= ?1), 0))");
  select.bind(1, std::min(today + 1, kLastDay));
  select.executeStep();
  return std::max(select.getColumn(0).getInt64(), today);
}

QuotaUse ReadQuotaUse(SQLite::Database& db, const std::string& team, const std::string& track,
                      const std::string& phase, int64_t now_ms) {
  QuotaUse use;
  use.day = QuotaDay(db, now_ms);
  const int64_t id = KnownTeamId(db, team);
  AddLedger(db, id, track, phase, use);
  AddOpen(db, id, track, phase, use);
  return use;
}

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
                               " may wait; hand in more when one of them has started"));
  }
  RETURN_IF_ERROR(CheckBudget(use, limits, budget, team, place));
  return CheckBudget(use, limits, Budget::kFailed, team, place);
}

absl::Status CheckFailures(const QuotaUse& use, const QuotaLimits& limits, const std::string& team,
                           const std::string& track) {
  return CheckBudget(use, limits, Budget::kFailed, team, Place(track, ""));
}

absl::Status WithErrorCode(absl::Status status, std::string_view code) {
  status.SetPayload(kCodeKey, absl::Cord(std::string(code)));
  return status;
}

std::string ErrorCodeOf(const absl::Status& status) {
  const auto code = status.GetPayload(kCodeKey);
  return code ? std::string(*code) : "";
}

}  // namespace myograde::server
