// The content of receipts (server/proof/receipt.h).
#pragma once

#include <cstdint>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/store/reader.h"

namespace myograde::server {

// Everything that a submission's result is a function of, and the result; in format 2 if its
// config hides its seeds, whether or not they have been revealed. FailedPreconditionError before it
// is done or failed.
absl::StatusOr<nlohmann::json> ReceiptOf(Reader& reader, int64_t submission);

}  // namespace myograde::server
