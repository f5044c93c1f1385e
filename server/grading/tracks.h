// Track configs in the daemon: those on offer, loaded and checked at start, and those of the store,
// where anything unreadable is a damaged row (store/damage.h).
#pragma once

#include <map>
#include <memory>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/mutex.h"
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

// The config that an accepted submission was made under, in whatever format it was stored.
absl::StatusOr<TrackConfig> StoredConfig(const Transaction& reader, const std::string& hash);

// The same as a track. A config that scoring rejects is a damaged row too.
absl::StatusOr<TrackPtr> StoredTrack(const Transaction& reader, const std::string& hash);

// The tracks on offer. Safe to use from any thread: a reader gets what is on offer at that moment.
class Tracks {
 public:
  // Reads every config of `dir` in every profile, and gives each its practice seeds: those that its
  // file names, as far as no config of the same environment ranks them, and free ones for the rest.
  // The error names the file.
  static absl::StatusOr<Tracks> Load(const std::string& dir);

  // `profile` "" is the track's default. NotFoundError with the code "unknown_track" or
  // "unknown_profile" (ErrorCodeOf in base/error_code.h) lists what exists.
  absl::StatusOr<TrackPtr> Find(const std::string& track, const std::string& profile) const;

  struct Entry {
    std::string default_profile;
    std::map<std::string, TrackPtr> profiles;
  };
  std::map<std::string, Entry> entries() const;

  // From now on offers `track` in place of what it has under the same name and profile, with practice
  // seeds that no config ranks. InvalidArgumentError if there is nothing of that name, profile and
  // environment.
  absl::Status Replace(const TrackPtr& track);

  // The track that ranks `seed`, among all of the same environment: what is trained on one of them
  // is trained for all. "": none does.
  std::string RankedBy(const TrackKind& kind, uint64_t seed) const;

 private:
  // What is offered at one time. Never changes.
  using Offer = std::map<std::string, Entry>;
  struct Shelf {
    Mutex mutex;
    // The configs with the practice seeds that their files name, and what is made of them.
    Offer named ABSL_GUARDED_BY(mutex);
    std::shared_ptr<const Offer> offer ABSL_GUARDED_BY(mutex);
  };

  // Gives the configs practice seeds beside those that any of the same environment ranks.
  static std::shared_ptr<const Offer> MakeOffer(const Offer& named);
  std::shared_ptr<const Offer> offer() const;

  std::unique_ptr<Shelf> shelf_ = std::make_unique<Shelf>();  // a mutex can't be moved
};

}  // namespace myograde::server
