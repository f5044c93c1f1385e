#include "server/grading/tracks.h"

#include <set>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/lease/practice_seeds.h"
#include "server/store/quota.h"

namespace myograde::server {
namespace {

template <typename Map>
std::string Keys(const Map& map) {
  return absl::StrJoin(map, ", ",
                       [](std::string* out, const auto& entry) { out->append(entry.first); });
}

}  // namespace

absl::StatusOr<TrackPtr> MakeTrack(TrackConfig config) {
  const scoring::ScoredTrack* track = scoring::FindScoredTrack(config.kind->name);
  if (track == nullptr) {
    return absl::InternalError(absl::StrCat("track config ", config.id, ": its track is in the "
                                            "registry of the protocol, and not in scoring's"));
  }
  absl::StatusOr<scoring::TrackScoring> scoring = track->parse(
      config.scoring,
      absl::StrCat("track config ", config.id, " (profile ", config.profile, "): scoring"));
  if (!scoring.ok()) return scoring.status();
  return std::make_shared<const Track>(Track{std::move(config), *std::move(scoring)});
}

absl::StatusOr<Tracks> Tracks::Load(const std::string& dir) {
  absl::StatusOr<std::vector<std::string>> names = ListTracks(dir);
  if (!names.ok()) return names.status();
  if (names->empty()) {
    return absl::NotFoundError(absl::StrCat(dir, ": holds no track config; give --configs the "
                                            "folder that has tracks/ in it"));
  }
  Tracks tracks;
  for (const std::string& name : *names) {
    absl::StatusOr<TrackConfig> usual = LoadTrackConfig(dir, name, "");
    if (!usual.ok()) return usual.status();
    Entry& offer = tracks.entries_[name];
    offer.default_profile = usual->profile;
    absl::StatusOr<std::vector<std::string>> profiles = ListProfiles(dir, name);
    if (!profiles.ok()) return profiles.status();
    for (const std::string& profile : *profiles) {
      absl::StatusOr<TrackConfig> config = LoadTrackConfig(dir, name, profile);
      if (!config.ok()) return config.status();
      absl::StatusOr<TrackPtr> track = MakeTrack(*std::move(config));
      if (!track.ok()) return track.status();
      for (const uint64_t seed : (*track)->config.seeds) {
        tracks.ranked_[(*track)->config.kind->name].try_emplace(seed, name);
      }
      offer.profiles[profile] = *std::move(track);
    }
  }
  tracks.GivePracticeSeeds();
  return tracks;
}

void Tracks::GivePracticeSeeds() {
  for (auto& [name, offer] : entries_) {
    for (auto& [profile, track] : offer.profiles) {
      TrackConfig config = track->config;
      std::set<uint64_t> taken;
      for (const auto& [seed, unused] : ranked_[config.kind->name]) taken.insert(seed);
      std::vector<uint64_t>& practice = config.practice_seeds;
      const size_t count = practice.empty() ? config.seeds.size() : practice.size();
      std::erase_if(practice, [&](uint64_t seed) { return taken.contains(seed); });
      taken.insert(practice.begin(), practice.end());
      const std::vector<uint64_t> more =
          DefaultPracticeSeeds(taken, static_cast<int64_t>(count - practice.size()));
      practice.insert(practice.end(), more.begin(), more.end());
      track = std::make_shared<const Track>(Track{std::move(config), track->scoring});
    }
  }
}

std::string Tracks::RankedBy(const TrackKind& kind, uint64_t seed) const {
  const auto of_kind = ranked_.find(kind.name);
  if (of_kind == ranked_.end()) return "";
  const auto found = of_kind->second.find(seed);
  return found == of_kind->second.end() ? "" : found->second;
}

absl::StatusOr<TrackPtr> Tracks::Find(const std::string& track, const std::string& profile) const {
  const auto offer = entries_.find(track);
  if (offer == entries_.end()) {
    return WithErrorCode(absl::NotFoundError(absl::StrCat("there is no track \"", track,
                                                          "\"; known: ", Keys(entries_))),
                         "unknown_track");
  }
  const std::string& wanted = profile.empty() ? offer->second.default_profile : profile;
  const auto found = offer->second.profiles.find(wanted);
  if (found == offer->second.profiles.end()) {
    return WithErrorCode(
        absl::NotFoundError(absl::StrCat("track \"", track, "\" has no profile \"", wanted,
                                         "\"; known: ", Keys(offer->second.profiles))),
        "unknown_profile");
  }
  return found->second;
}

}  // namespace myograde::server
