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

// Adds where an evaluation stands in the queue, why it waits, and when it will probably have ended:
// `queue`, `waiting`, `started_at`, `running_wall_s`, `remaining_wall_s` and `estimated_end_at`.
// Returns what they were made of.
QueueOutlook AddOutlook(const ApiContext& context, const EvaluationRow& evaluation,
                        const EpisodeCounts& counts, nlohmann::json& json);

// The answer to GET /v1/submissions/ID. NotFoundError: there is no such submission.
absl::StatusOr<nlohmann::json> SubmissionStatus(Reader& reader, const ApiContext& context,
                                                int64_t submission);

}  // namespace myograde::server
