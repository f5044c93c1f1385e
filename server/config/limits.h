// How much one may submit, upload and rerun: what server.json and challenges give, and the store
// keeps to.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include <absl/time/time.h>

#include "server/base/enum_names.h"

namespace myograde::server {

enum class Budget { kRanked, kPractice, kFailed };
template <>
inline constexpr std::string_view kNamesOf<Budget>[] = {"official", "practice", "failed"};
inline constexpr std::array kBudgets = {Budget::kRanked, Budget::kPractice, Budget::kFailed};

// Units; every number is at least 1.
struct Allowance {
  int64_t per_day = 0;
  int64_t total = 0;
};

// For one team on one track.
struct QuotaLimits {
  Allowance ranked;
  Allowance practice;
  Allowance failed;
  int64_t waiting = 0;  // evaluations waiting for their first block at the same time

  const Allowance& of(Budget budget) const {
    if (budget == Budget::kRanked) return ranked;
    return budget == Budget::kPractice ? practice : failed;
  }
};

// What a submission must satisfy to be accepted.
struct AdmissionRules {
  QuotaLimits quota;
  // An artefact has one ranked evaluation per config: for each team or, if true, for all teams
  // together.
  bool one_for_everyone = false;
};

// Limits on artefacts with files that nobody has submitted.
struct UnsubmittedLimits {
  int64_t count = 4000;
  int64_t bytes = int64_t{64} << 30;
  int64_t of_one = 1000;  // per uploader, and per team
  int64_t bytes_of_one = int64_t{16} << 30;
  absl::Duration age = absl::Hours(24);  // after which the files are removed
};

// Limits on reruns that have not ended.
struct RerunLimits {
  int64_t unfinished = 64;  // total of all non-organisers
  int64_t of_one = 8;       // per non-organiser
  int64_t of_a_submission = 2;
  int64_t of_organisers = 256;
};

}  // namespace myograde::server
