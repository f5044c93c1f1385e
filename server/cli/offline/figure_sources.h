// What figures and reports are drawn from, as the daemon tells it to the caller: nothing else is
// asked, so nobody sees more in a figure than in an answer of the API.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>

#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {

// A submission's result with its episodes, without what no figure shows. Errors of Client::Get.
absl::StatusOr<Json> ResultForFigures(const Client& client, int64_t submission);

// Adds "board", "statistics" and "moments" to `order`. Moments are how the board was whenever
// something changed, each with "at" and "rows", oldest first; the last is now. They come from the
// public record; of more than 200 changes as many are taken, evenly.
absl::Status AddBoard(const Client& client, const BoardChoice& choice, Json& order);

// Adds "results" to `order`, one of each row of its "board": the evaluation with its episodes, or
// "submission", "team", "name" and in "error" why the caller does not see it.
absl::Status AddResultsOfBoard(const Client& client, Json& order);

// Adds "challenge", its title, and "phase", as GET /v1/challenges has it; null if no challenge has
// the phase of the order's "board".
absl::Status AddPhase(const Client& client, Json& order);

}  // namespace myograde::server
