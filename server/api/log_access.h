// Who may see what was recorded of an episode: its log, and what is made of it.
#pragma once

#include <string>

#include <absl/status/status.h>

#include "server/api/context.h"

namespace myograde::server {

// There is no such log, or none for this caller.
absl::Status MissingLog(const std::string& hash);

// Whether the caller may see a log: one of their teams' episodes has it, and its phase shows logs.
// MissingLog, or an error with the code "withheld". Organisers may see every one. Only inside handlers.
absl::Status RequireShownLog(const ApiContext& context, const std::string& hash);

}  // namespace myograde::server
