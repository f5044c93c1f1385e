// Submissions as JSON.
#pragma once

#include <cstdint>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/store/reader.h"
#include "server/store/rows.h"

namespace myograde::server {

// The keys that lists, a submission's status and its evaluations have in common. `counts` are those
// of `evaluation`.
nlohmann::json SubmissionToJson(const SubmissionRow& row, const EvaluationRow& evaluation,
                                const EpisodeCounts& counts);

// The answer to GET /v1/submissions/ID. NotFoundError: there is no such submission.
absl::StatusOr<nlohmann::json> SubmissionStatus(Reader& reader, const ApiContext& context,
                                                int64_t submission);

}  // namespace myograde::server
