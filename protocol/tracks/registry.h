// All tracks. A new one has its folder here, a line in registry.cc and one in episode_facts.h.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/tracks/track_kind.h"

namespace myograde {

// In the order in which they came into being.
std::span<const TrackKind* const> AllTracks();

// Their names, in the same order.
std::vector<std::string> TrackNames();

// nullptr if there is none of that name.
const TrackKind* FindTrack(std::string_view name);

// True if the facts are of an episode of this track.
bool AreFactsOf(const TrackKind& track, const TrackFacts& facts);

// The reason or the end of a word; nullopt if neither all tracks have it nor any.
std::optional<FailureReason> ParseFailureReason(std::string_view name);
std::optional<EpisodeEnd> ParseEpisodeEnd(std::string_view name);

}  // namespace myograde
