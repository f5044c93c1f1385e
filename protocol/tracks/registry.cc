#include "protocol/tracks/registry.h"

#include <array>
#include <utility>

#include "protocol/tracks/baoding/track.h"
#include "protocol/tracks/chasetag/track.h"
#include "protocol/tracks/elbow/track.h"
#include "protocol/tracks/locomotion/track.h"
#include "protocol/tracks/manipulation/track.h"
#include "protocol/tracks/relocation/track.h"
#include "protocol/tracks/reorientation/track.h"

namespace myograde {
namespace {

// Looks up a name among those that every track has and each track's own.
template <typename Word, typename... Facts, typename OwnWords>
std::optional<Word> Find(std::string_view name, std::initializer_list<Word> common,
                         std::variant<Facts...>*, OwnWords own_words) {
  std::optional<Word> found;
  const auto look = [&](const auto& words) {
    for (const Word& word : words) {
      if (word.name() == name) found = word;
    }
  };
  look(common);
  (look(own_words(Facts())), ...);
  return found;
}

constexpr TrackFacts* kEveryFacts = nullptr;

}  // namespace

std::span<const TrackKind* const> AllTracks() {
  // The warm-up comes last: "myograde try" plays it where no track is named.
  static const std::array all = {&ManipulationTrack(), &LocomotionTrack(), &ReorientationTrack(),
                                 &BaodingTrack(), &RelocationTrack(), &ChaseTagTrack(),
                                 &ElbowTrack()};
  return all;
}

std::vector<std::string> TrackNames() {
  std::vector<std::string> names;
  for (const TrackKind* track : AllTracks()) names.emplace_back(track->name);
  return names;
}

const TrackKind* FindTrack(std::string_view name) {
  for (const TrackKind* track : AllTracks()) {
    if (track->name == name) return track;
  }
  return nullptr;
}

bool AreFactsOf(const TrackKind& track, const TrackFacts& facts) {
  return track.no_facts.index() == facts.index();
}

std::optional<FailureReason> ParseFailureReason(std::string_view name) {
  return Find<FailureReason>(
      name, {FailureReason::kNone, FailureReason::kTime, FailureReason::kGivenUp}, kEveryFacts,
      [](const auto& facts) { return facts.kReasons; });
}

std::optional<EpisodeEnd> ParseEpisodeEnd(std::string_view name) {
  return Find<EpisodeEnd>(name, {EpisodeEnd::kTime, EpisodeEnd::kGivenUp, EpisodeEnd::kFault},
                          kEveryFacts, [](const auto& facts) { return facts.kEnds; });
}

}  // namespace myograde
