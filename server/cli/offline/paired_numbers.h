// Two submissions on the same seeds.
#pragma once

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

namespace myograde::server {

// The episodes that results `a` and `b` (of the API, with rows) both played with the same seed, by
// metric: {"pairs": N, "metrics": [{"name", "title", "unit", "better", "digits", "differences",
// "difference", "low", "high", "p", "pairs", "differing", "method"}]}. Differences are a less b.
// Interval and p-value are those of scoring/paired_test.h, not corrected for several tests.
// FailedPreconditionError if no episode can be compared.
absl::StatusOr<nlohmann::json> PairedNumbers(const nlohmann::json& a, const nlohmann::json& b);

}  // namespace myograde::server
