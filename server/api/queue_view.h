// The queue as JSON.
#pragma once

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/store/reader.h"

namespace myograde::server {

// The answer to GET /v1/queue: how busy the host is, and what waits or is played of the submissions
// that the caller may see. Only inside handlers.
absl::StatusOr<nlohmann::json> QueueView(Reader& reader, const ApiContext& context);

}  // namespace myograde::server
