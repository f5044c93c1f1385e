// How a verb ends that asks the daemon once.
#pragma once

#include <functional>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

namespace myograde::server {

// Prints the daemon's answer: as it is if `json`, else by `print`. An error is reported instead.
// Returns the exit status.
int PrintAnswer(const absl::StatusOr<nlohmann::json>& answer, bool json,
                const std::function<void(const nlohmann::json&)>& print);

}  // namespace myograde::server
