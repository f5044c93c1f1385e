// The signed documents of rejudges: what was done, by which rules, why, and with which results.
#pragma once

#include <memory>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/store/rejudges.h"

namespace myograde::server {

// The document of an event. `items`: those whose results it makes those of the board, for an
// application; otherwise none.
nlohmann::json RejudgeDocument(const RejudgeRow& rejudge, const RejudgeEventRow& event,
                               const std::vector<RejudgeItemRow>& items);

// What makes and signs the document of the act that the store is about to write, with the key of
// receipts. An error if there is no key.
absl::StatusOr<SignRejudge> RejudgeSigner(const ApiContext& context);

}  // namespace myograde::server
