// All tracks. A new track needs a folder here, a line in registry.cc, and one each in
// episode_facts.h and episode_details.h.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/tracks/track_kind.h"

namespace myograde {

// In the order in which they were added.
std::span<const TrackKind* const> AllTracks();

// Their names, in the same order.
std::vector<std::string> TrackNames();

// nullptr if there is no track of that name.
const TrackKind* FindTrack(std::string_view name);

// True if the facts are of an episode of this track.
bool AreFactsOf(const TrackKind& track, const TrackFacts& facts);

// Looks up a reason or ending by name; nullopt if neither the common ones nor any track's own
// include it.
std::optional<FailureReason> ParseFailureReason(std::string_view name);
std::optional<EpisodeEnd> ParseEpisodeEnd(std::string_view name);

}  // namespace myograde
