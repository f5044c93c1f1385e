// An evaluation's logs, as the daemon has them.
#pragma once

#include <absl/status/statusor.h>

#include <string>

#include "protocol/log/episode_log.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {

// An evaluation with its rows; `path` without a query.
absl::StatusOr<Json> EvaluationWithRows(const Client& client, const std::string& path);

// The row of one episode of such an evaluation. OutOfRangeError if it has none.
absl::StatusOr<Json> RowOf(const Json& evaluation, int64_t episode);

// The whole log of that SHA-256, or that a row names, unpacked. DataLossError, of a row with the
// episode, if it was altered; the daemon's error if it is gone; FailedPreconditionError if the row
// names none.
absl::StatusOr<std::string> LogBytesOf(const Client& client, const std::string& sha256);
absl::StatusOr<std::string> LogBytesOf(const Client& client, const Json& row);
absl::StatusOr<EpisodeLog> LogOf(const Client& client, const Json& row);

}  // namespace myograde::server
