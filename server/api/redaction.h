// What the caller of a request may see of an evaluation (server/access/access.h), from the
// challenge files and the store, and the removal of the rest from answers. Every key of an answer
// is listed with what it takes to see it; one that is not listed is withheld as soon as anything is.
#pragma once

#include <string>

#include <absl/status/status.h>
#include <nlohmann/json.hpp>

#include "protocol/lease/track_config.h"
#include "server/access/access.h"
#include "server/api/context.h"
#include "server/store/store.h"

namespace myograde::server {

// --- Only inside handlers: ---

// Whether anybody at all may see the receipts of a phase's evaluations ("": of none): it is
// published, or withholds nothing of them and never freezes its board.
bool IsPhasePublic(const Transaction& reader, const ApiContext& context, const std::string& phase);

// Whether everybody may watch the best episode of the leader on the board of a config.
bool IsReplayPublic(const Transaction& reader, const ApiContext& context,
                    const TrackConfig& config);

// Of evaluations of a phase ("": of none).
Visibility FindPhaseVisibility(const Transaction& reader, const ApiContext& context,
                        const std::string& phase);

// Of evaluations under a config.
Visibility FindConfigVisibility(const Transaction& reader, const ApiContext& context,
                         const TrackConfig& config);

inline constexpr char kWithheldCode[] = "withheld";
// For what is refused as a whole as long as a phase withholds parts of it: FailedPreconditionError
// with the code "withheld", which adds when that ends.
absl::Status WithheldError(const std::string& what);

// --- Pure: ---

// The answers to GET /v1/evaluations/ID and /v1/submissions/ID/result.
void RedactEvaluation(nlohmann::json& answer, const Visibility& visibility);

// The answer to GET /v1/submissions/ID.
void RedactStatus(nlohmann::json& answer, const Visibility& visibility);

// An entry of the answer to GET /v1/submissions.
void RedactListed(nlohmann::json& entry, const Visibility& visibility);

// A row of a team's ledger: the charge names how an episode ended.
void RedactLedgerRow(nlohmann::json& row, const Visibility& visibility);

}  // namespace myograde::server
