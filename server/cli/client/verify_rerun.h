// rerun --verify: for each episode of a re-run whether actions, states and
// result were the same, and if not, whose doing it is.
#pragma once

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/cli/client/client.h"

namespace myograde::server {

// The object `verify` of rerun's JSON. `rerun`: the evaluation with its
// comparison. Where the rows differ, the logs of both playings are asked for.
//   {"same": true|false, "verdict": "same" | "policy" | "simulator" | "scoring" | "unknown",
//    "episodes": [{"index", "actions", "states", "result" (each true if the same), "verdict",
//                  "step", "detail"}]}
absl::StatusOr<nlohmann::json> VerifyRerun(const Client& client, const nlohmann::json& rerun);

// One line for each episode that is not the same, and the verdict.
void PrintVerify(const nlohmann::json& verify);

}  // namespace myograde::server
