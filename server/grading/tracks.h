// Track configs with the rules that they are judged by. Anything unreadable in one of the store is a
// damaged row (store/damage.h).
#pragma once

#include <memory>
#include <string>

#include <absl/status/statusor.h>

#include "protocol/lease/track_config.h"
#include "scoring/track.h"

namespace myograde::server {

class Transaction;

// One profile of a track. Immutable and shared.
struct Track {
  TrackConfig config;
  scoring::TrackScoring scoring;
};
using TrackPtr = std::shared_ptr<const Track>;

// Errors name the config, the key and its range.
absl::StatusOr<TrackPtr> MakeTrack(TrackConfig config);

// One that the store has, in whatever format it was stored.
absl::StatusOr<TrackPtr> StoredTrack(const Transaction& reader, const std::string& hash);

}  // namespace myograde::server
