// An evaluation's logs, as the daemon has them.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <string>

#include "protocol/log/episode_log.h"
#include "protocol/log/packed_log.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {

// An evaluation with its rows; `path` without a query.
absl::StatusOr<Json> EvaluationWithRows(const Client& client, const std::string& path);

// The row of one episode of such an evaluation. OutOfRangeError if it has none.
absl::StatusOr<Json> RowOf(const Json& evaluation, int64_t episode);

// Gets the log of that SHA-256 and gives it to `sink` unpacked, piece by piece. It is the right one
// only if that is OK: DataLossError if it was altered, the daemon's error if it is gone, or what
// `sink` said.
absl::Status ReadLogOf(const Client& client, const std::string& sha256,
                       const LogUnpacker::Sink& sink);

// The same of the log that a row names. FailedPreconditionError if the row names none;
// DataLossError names the episode.
absl::Status ReadLogOf(const Client& client, const Json& row, const LogUnpacker::Sink& sink);

// The whole log of that SHA-256, or that a row names; errors as above.
absl::StatusOr<std::string> LogBytesOf(const Client& client, const std::string& sha256);
absl::StatusOr<std::string> LogBytesOf(const Client& client, const Json& row);
absl::StatusOr<EpisodeLog> LogOf(const Client& client, const Json& row);

}  // namespace myograde::server
