// Quotas: how much a team may submit on a track, or to a phase of a challenge, as a function of the
// store's rows; README.md has the rules. Each phase counts its own rows; the track itself counts
// those of no phase.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include <absl/status/status.h>
#include "server/config/limits.h"
#include "server/store/context.h"
#include "server/store/damage.h"
#include "server/store/rows.h"

namespace myograde::server {

// Use of one budget, in units, either on the current day or in total.
struct BudgetUse {
  int64_t charged = 0;  // net of refunds
  int64_t open = 0;     // accepted, neither ended nor charged
  int64_t granted = 0;  // in addition to the limit

  int64_t left(int64_t limit) const { return limit + granted - charged - open; }
};

struct QuotaUse {
  int64_t day = 0;  // since 1970-01-01 UTC
  int64_t waiting = 0;
  std::array<BudgetUse, 3> today;  // by Budget
  std::array<BudgetUse, 3> total;

  const BudgetUse& today_of(Budget budget) const { return today[static_cast<size_t>(budget)]; }
  const BudgetUse& total_of(Budget budget) const { return total[static_cast<size_t>(budget)]; }
};

// Limits for a valid row: the last day of the year 9999, and the most units.
inline constexpr int64_t kLastDay = 2'932'896;
inline constexpr int64_t kMostUnits = 1'000'000'000;

// "2024-12-01" for 20058.
std::string DayName(int64_t day);

// Whether one more submission fits. FailedPreconditionError with the code "quota" says what is used
// up and when it becomes available again.
absl::Status CheckQuota(const QuotaUse& use, const QuotaLimits& limits, Budget budget,
                        const std::string& team, const std::string& track,
                        const std::string& phase = "");
// The same for the budget `failed` alone: whether it has room for one more failure.
absl::Status CheckFailures(const QuotaUse& use, const QuotaLimits& limits, const std::string& team,
                           const std::string& track);

// Extra units for a team, for the store's current day and in total.
struct NewGrant {
  std::string team;
  std::string track;
  Budget budget = Budget::kRanked;
  int64_t amount = 0;
  std::string why;
  std::string phase = "";  // "": the track itself
};

// What teams have used, and grants.
class Quotas : StorePart {
 public:
  using StorePart::StorePart;

  // `phase` "": of the track itself.
  QuotaUse CountQuotaUse(const std::string& team, const std::string& track, int64_t now_ms,
                         const std::string& phase = "") const;
  // The store's current day: today, or tomorrow if there are rows of it.
  int64_t DayAt(int64_t now_ms) const;
  // The budget that a submission is charged to; "" if none, or if it was refunded.
  std::string ChargedBudget(int64_t submission) const;
  // Newest first. `track` "" matches any; `before` is an id.
  Listed<LedgerRow> Ledger(const std::string& team, const std::string& track, int64_t before,
                           int64_t limit) const;
  // Charges an original evaluation that is about to be cancelled, if a block of it has begun:
  // whoever may not see its episodes might have learned something of them by then.
  void ChargeBegun(int64_t evaluation);
  // Charges one unit of the budget `failed` for an attempt that never became a submission.
  absl::Status ChargeFailure(const std::string& team, const std::string& track,
                             const std::string& who, const std::string& why);
  absl::Status Grant(const NewGrant& grant, const std::string& who);
  void ChargeFirstEpisode(int64_t evaluation, const std::string& why);
  void Settle(int64_t evaluation, EvaluationState state, const std::string& who);

 private:
  // Adds an entry of no submission, as of the store's current day.
  absl::Status AddUnits(const char* entry, const NewGrant& units, const std::string& who);
};

}  // namespace myograde::server
