// Track configs of the store. Anything unreadable is a damaged row (store/damage.h).
#pragma once

#include <string>

#include <absl/status/statusor.h>

#include "server/grading/tracks.h"
#include "server/store/reader.h"

namespace myograde::server {

// The config that an accepted submission was made under, in whatever format it was stored.
absl::StatusOr<TrackConfig> StoredConfig(Reader& reader, const std::string& hash);

// The same as a track. A config that scoring rejects is a damaged row too.
absl::StatusOr<TrackPtr> StoredTrack(Reader& reader, const std::string& hash);

}  // namespace myograde::server
