// Phases as JSON.
#pragma once

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/store/reader.h"

namespace myograde::server {

// The answer to GET /v1/challenges.
absl::StatusOr<nlohmann::json> ChallengesToJson(Reader& reader, const ApiContext& context);

}  // namespace myograde::server
