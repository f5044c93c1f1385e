// What the caller of a request may see of an evaluation, from the challenge files and the store.
#pragma once

#include <string>

#include <absl/status/statusor.h>

#include "protocol/lease/track_config.h"
#include "server/access/sight.h"
#include "server/api/context.h"
#include "server/store/reader.h"

namespace myograde::server {

// Of evaluations of a phase ("": of none).
absl::StatusOr<Visibility> SightOfPhase(Reader& reader, const ApiContext& context, Role role,
                                        const std::string& phase);

// Of evaluations under a config.
absl::StatusOr<Visibility> SightOfConfig(Reader& reader, const ApiContext& context, Role role,
                                         const TrackConfig& config);

}  // namespace myograde::server
