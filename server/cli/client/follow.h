// Waiting for the daemon to finish an evaluation.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/cli/client/client.h"

namespace myograde::server {

// True for a state that an evaluation does not leave.
bool IsFinalState(const std::string& state);

// The exit status that a final state stands for.
int ExitOfState(const std::string& state);

// Asks for `path` (a submission's status or an evaluation) until its state is
// final, showing progress named `what`; the last answer. A daemon that stays
// silent for 30 s in a row ends the waiting; one that restarts does not.
absl::StatusOr<nlohmann::json> Follow(const Client& client, const std::string& path,
                                      const std::string& what);

// The same for anything that is in progress: until an answer is `final`.
absl::StatusOr<nlohmann::json> FollowUntil(
    const Client& client, const std::string& path, const std::string& what,
    const std::function<bool(const nlohmann::json&)>& final);

}  // namespace myograde::server
