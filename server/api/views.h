// The parts of the API's answers that more than one address tells.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <absl/time/time.h>
#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/api/requests.h"
#include "server/api/routes.h"
#include "server/base/json_value.h"
#include "server/executor/executor.h"
#include "server/store/damage.h"
#include "server/store/rows.h"

namespace myograde::server {

using Json = nlohmann::json;

// UTC with milliseconds; null for 0 ("not yet").
Json TimeToJson(int64_t ms);
// Of what a list could not show: [{"table": "episode", "key": "7/3", "message": "…"}].
Json DamagedToJson(const std::vector<Damage>& damaged);
Json SecondsOrNull(const std::optional<absl::Duration>& duration);
// One row of `episode_rows`; with the salt of a config that hides its seeds (not ""), it has
// "seed_commitment", too.
Json EpisodeToJson(const EpisodeRow& row, const std::string& seed_salt);
// Changes of a submission's marks, oldest first.
Json MarksToJson(const std::vector<MarkRow>& rows);
// A rerun against its original; both sorted by index.
Json CompareRows(int64_t original, const std::vector<EpisodeRow>& original_rows,
                 const EvaluationRow& rerun, const std::vector<EpisodeRow>& rerun_rows);
// The nodes of a cluster by name: what the executor knows, and what the store has as drained,
// though the executor has not met it; without a cluster only the former.
Json NodesToJson(const std::vector<NodeView>& known, const std::vector<DrainedNodeRow>& drained,
                 bool remote);

// The time `duration` from now; null if it is not known.
Json Ahead(const std::optional<absl::Duration>& duration, absl::Time now);

// The keys that lists, a submission's status and its evaluations have in common. `counts` are those
// of `evaluation`.
Json SubmissionToJson(const SubmissionRow& row, const EvaluationRow& evaluation,
                      const EpisodeCounts& counts);

// Adds where an evaluation stands in the queue, why it waits, and when it will probably have ended:
// `queue`, `waiting`, `started_at`, `running_wall_s`, `remaining_wall_s` and `estimated_end_at`.
// Returns what they were made of.
QueueOutlook AddOutlook(const ApiContext& context, const EvaluationRow& evaluation,
                        const EpisodeCounts& counts, Json& json);

// Says in an answer to `request`, in `next_before` and a Link header, that its list goes on below
// `last_id` if `more`, or that it ends.
void AddNextPage(const Request& request, bool more, int64_t last_id, ApiAnswer& answer);
// The same for rows that were read as `page`: a full page may have another one behind it.
template <typename Row>
void AddNextPage(const Request& request, const Page& page, const Listed<Row>& listed,
                 ApiAnswer& answer) {
  AddNextPage(request, listed.found() >= page.limit, listed.last_id, answer);
}
// A page of a list as the answer to `request`: its rows at `key`, each as `to_json` has it.
template <typename Row, typename RowToJson>
ApiAnswer PageAnswer(const Request& request, const Page& page, const char* key,
                     const Listed<Row>& listed, const RowToJson& to_json) {
  ApiAnswer answer{200, {{key, Json::array()}}};
  for (const Row& row : listed.rows) answer.body[key].push_back(to_json(row));
  AddNextPage(request, page, listed, answer);
  return answer;
}

}  // namespace myograde::server
