// Removes from answers what their reader may not see (server/access/sight.h). Every key of an
// answer is listed with what it takes to see it; one that is not listed is withheld as soon as
// anything is.
#pragma once

#include <nlohmann/json.hpp>

#include "server/access/sight.h"

namespace myograde::server {

// The answers to GET /v1/evaluations/ID and /v1/submissions/ID/result.
void RedactEvaluation(nlohmann::json& answer, const Visibility& sight);

// The answer to GET /v1/submissions/ID.
void RedactStatus(nlohmann::json& answer, const Visibility& sight);

// An entry of the answer to GET /v1/submissions.
void RedactListed(nlohmann::json& entry, const Visibility& sight);

// A row of a team's ledger: the charge names how an episode ended.
void RedactLedgerRow(nlohmann::json& row, const Visibility& sight);

}  // namespace myograde::server
