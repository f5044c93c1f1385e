// Statuses as the errors that clients get.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <absl/status/status.h>

#include "server/http/request.h"
#include "server/store/quota.h"

namespace myograde::server {

// The entry of README.md's table of errors for a status: by its code (ErrorCodeOf of
// store/quota.h) if it has one, otherwise by its kind.
ApiError ErrorOf(const absl::Status& status);
// 503 `busy`, to be asked again after so many seconds.
absl::Status Busy(std::string_view message, int64_t retry_after_s);
// The same for an operation that takes a team's name. Only organisers are told which existing team
// a refused name looks like. Only inside handlers.
absl::Status TeamErrorOf(const absl::Status& status, const std::string& team);

}  // namespace myograde::server
