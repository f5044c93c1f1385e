// The content of receipts (server/proof/receipt.h).
#pragma once

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/api/record_log.h"
#include "server/store/reader.h"

namespace myograde::server {

// Everything that the result of a submission's evaluation is a function of, and the result; in
// format 2 if its config hides its seeds, whether or not they have been revealed. `record` proves
// where the public record has it. FailedPreconditionError before it is done or failed.
absl::StatusOr<nlohmann::json> ReceiptOf(Reader& reader, RecordLog& record,
                                         const SubmissionRow& submission,
                                         const EvaluationRow& evaluation);

}  // namespace myograde::server
