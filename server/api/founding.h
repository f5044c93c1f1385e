// For which teams a caller may hand something in.
#pragma once

#include <optional>
#include <string>

#include <absl/status/statusor.h>

#include "server/api/context.h"
#include "server/store/store.h"

namespace myograde::server {

// Whether the caller may act for the team called `team`, and if so, what makes them its first
// member: nullopt if nothing has to. NotFoundError: it is not theirs, and they can't found it. Only
// inside handlers.
absl::StatusOr<std::optional<Founding>> FoundingFor(const ApiContext& context,
                                                    const std::string& team);

}  // namespace myograde::server
