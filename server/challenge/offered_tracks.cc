#include "server/challenge/offered_tracks.h"

#include <algorithm>
#include <set>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/status_macros.h"
#include "protocol/lease/practice_seeds.h"
#include "server/base/error_code.h"

namespace myograde::server {
namespace {

template <typename Map>
std::string Keys(const Map& map) {
  return absl::StrJoin(map, ", ",
                       [](std::string* out, const auto& entry) { out->append(entry.first); });
}

}  // namespace

absl::StatusOr<Tracks> Tracks::Load(const std::string& dir) {
  ASSIGN_OR_RETURN(std::vector<std::string> names, ListTracks(dir));
  if (names.empty()) {
    return absl::NotFoundError(absl::StrCat(dir,
                                            ": has no track configs; give --configs a folder with "
                                            "tracks/"));
  }
  std::map<std::string, Entry> named;
  for (const std::string& name : names) {
    ASSIGN_OR_RETURN(TrackProfiles profiles, LoadProfiles(dir, name));
    Entry& offer = named[name];
    offer.default_profile = profiles.default_profile;
    for (auto& [profile, config] : profiles.configs) {
      ASSIGN_OR_RETURN(offer.profiles[profile], MakeTrack(std::move(config)));
    }
  }
  Tracks tracks;
  const MutexLock lock(tracks.shelf_->mutex);
  tracks.shelf_->offer = MakeOffer(named);
  tracks.shelf_->named = std::move(named);
  return tracks;
}

namespace {

// Those that the file names and nothing ranks, and free ones for the rest.
std::vector<uint64_t> PracticeBeside(const TrackConfig& config, std::set<uint64_t> taken) {
  std::vector<uint64_t> practice = config.practice_seeds;
  const size_t count = practice.empty() ? config.seeds.size() : practice.size();
  std::erase_if(practice, [&](uint64_t seed) { return taken.contains(seed); });
  taken.insert(practice.begin(), practice.end());
  const std::vector<uint64_t> more =
      DefaultPracticeSeeds(taken, static_cast<int64_t>(count - practice.size()));
  practice.insert(practice.end(), more.begin(), more.end());
  return practice;
}

}  // namespace

std::shared_ptr<const Tracks::Offer> Tracks::MakeOffer(const Offer& named) {
  std::map<const TrackKind*, std::set<uint64_t>> ranked;
  for (const auto& [name, entry] : named) {
    for (const auto& [profile, track] : entry.profiles) {
      ranked[track->config.kind].insert(track->config.seeds.begin(), track->config.seeds.end());
    }
  }
  auto offer = std::make_shared<Offer>(named);
  for (auto& [name, entry] : *offer) {
    for (auto& [profile, track] : entry.profiles) {
      TrackConfig config = track->config;
      config.practice_seeds = PracticeBeside(config, ranked[config.kind]);
      track = std::make_shared<const Track>(Track{std::move(config), track->scoring});
    }
  }
  return offer;
}

std::shared_ptr<const Tracks::Offer> Tracks::offer() const {
  const MutexLock lock(shelf_->mutex);
  return shelf_->offer;
}

std::map<std::string, Tracks::Entry> Tracks::entries() const { return *offer(); }

absl::Status Tracks::Replace(const TrackPtr& track) {
  const TrackConfig& config = track->config;
  const MutexLock lock(shelf_->mutex);
  const auto entry = shelf_->named.find(config.id);
  if (entry == shelf_->named.end() || !entry->second.profiles.contains(config.profile)) {
    return absl::InvalidArgumentError(
        absl::StrCat("config ", config.hash, " is of track \"", config.id, "\" in the profile \"",
                     config.profile, "\", which this server does not offer"));
  }
  TrackPtr& place = entry->second.profiles[config.profile];
  if (!config.phase.empty() || place->config.kind != config.kind) {
    return absl::InvalidArgumentError(
        absl::StrCat("config ", config.hash, " is of ",
                     config.phase.empty() ? absl::StrCat("environment \"", std::string(config.kind->name), "\"")
                                          : absl::StrCat("phase \"", config.phase, "\""),
                     ", and can't take the place of that of track \"", config.id, "\""));
  }
  TrackConfig named = config;
  named.practice_seeds = place->config.practice_seeds;
  place = std::make_shared<const Track>(Track{std::move(named), track->scoring});
  shelf_->offer = MakeOffer(shelf_->named);
  return absl::OkStatus();
}

std::string Tracks::RankedBy(const TrackKind& kind, uint64_t seed) const {
  const std::shared_ptr<const Offer> now = offer();
  for (const auto& [name, entry] : *now) {
    for (const auto& [profile, track] : entry.profiles) {
      const std::vector<uint64_t>& seeds = track->config.seeds;
      if (track->config.kind == &kind && std::ranges::find(seeds, seed) != seeds.end()) return name;
    }
  }
  return "";
}

absl::StatusOr<TrackPtr> Tracks::Find(const std::string& track, const std::string& profile) const {
  const std::shared_ptr<const Offer> now = offer();
  const auto entry = now->find(track);
  if (entry == now->end()) {
    return WithErrorCode(absl::NotFoundError(absl::StrCat("there is no track \"", track,
                                                          "\"; known: ", Keys(*now))),
                         "unknown_track");
  }
  const std::string& wanted = profile.empty() ? entry->second.default_profile : profile;
  const auto found = entry->second.profiles.find(wanted);
  if (found == entry->second.profiles.end()) {
    return WithErrorCode(
        absl::NotFoundError(absl::StrCat("track \"", track, "\" has no profile \"", wanted,
                                         "\"; known: ", Keys(entry->second.profiles))),
        "unknown_profile");
  }
  return found->second;
}

}  // namespace myograde::server
