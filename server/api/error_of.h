// Statuses as the errors that clients get.
#pragma once

#include <string>

#include <absl/status/status.h>

#include "server/api/api_error.h"

namespace myograde::server {

// The entry of README.md's table of errors for a status: by its code (ErrorCodeOf of
// store/quota.h) if it has one, otherwise by its kind.
ApiError ErrorOf(const absl::Status& status);
// A status that ErrorOf turns into `error`, for what no kind of status says.
absl::Status StatusOf(const ApiError& error);
// The same for an operation that takes a team's name. Only organisers are told which existing team
// a refused name looks like. Only inside handlers.
absl::Status TeamErrorOf(const absl::Status& status, const std::string& team);

}  // namespace myograde::server
