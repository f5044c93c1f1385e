// The tracks on offer: the files of a folder, and what rejudges put in their place.
#pragma once

#include <map>
#include <memory>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/mutex.h"
#include "server/grading/tracks.h"

namespace myograde::server {

// Safe to use from any thread: a reader gets what is on offer at that moment.
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
