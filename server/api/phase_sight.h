// What the caller of a request may see of an evaluation, from the challenge files and the store.
// Only inside handlers.
#pragma once

#include <string>

#include <absl/status/statusor.h>

#include "protocol/lease/track_config.h"
#include "server/access/sight.h"
#include "server/api/context.h"
#include "server/store/reader.h"

namespace myograde::server {

// Whether anybody at all may see the receipts of a phase's evaluations ("": of none): it is
// published, or withholds nothing of them and never freezes its board.
absl::StatusOr<bool> IsPhasePublic(Reader& reader, const ApiContext& context,
                                   const std::string& phase);

// Of evaluations of a phase ("": of none).
absl::StatusOr<Visibility> SightOfPhase(Reader& reader, const ApiContext& context,
                                        const std::string& phase);

// Of evaluations under a config.
absl::StatusOr<Visibility> SightOfConfig(Reader& reader, const ApiContext& context,
                                         const TrackConfig& config);

inline constexpr char kWithheldCode[] = "withheld";
// For what is refused as a whole as long as a phase withholds parts of it: FailedPreconditionError
// with the code "withheld", which adds when that ends.
absl::Status WithheldError(const std::string& what);

}  // namespace myograde::server
