// An evaluation's logs, as the daemon has them.
#pragma once

#include <string>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/episode_log.h"
#include "server/cli/client.h"

namespace myograde::server {

// An evaluation with its rows; `path` without a query.
absl::StatusOr<nlohmann::json> EvaluationWithRows(const Client& client, const std::string& path);

// The row of one episode of such an evaluation. OutOfRangeError if it has none.
absl::StatusOr<nlohmann::json> RowOf(const nlohmann::json& evaluation, int64_t episode);

// The log that a row names, packed as it is stored. FailedPreconditionError if
// the row names none; the daemon's error if it is gone.
absl::StatusOr<std::string> PackedLogOf(const Client& client, const nlohmann::json& row);

// The same, unpacked and held against the row's hash: DataLossError names an
// altered log.
absl::StatusOr<std::string> LogBytesOf(const Client& client, const nlohmann::json& row);
absl::StatusOr<EpisodeLog> LogOf(const Client& client, const nlohmann::json& row);

}  // namespace myograde::server
