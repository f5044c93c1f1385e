#include "scoring/track.h"

#include <array>

#include "scoring/baoding/track.h"
#include "scoring/chasetag/track.h"
#include "scoring/elbow/track.h"
#include "scoring/locomotion/track.h"
#include "scoring/manipulation/track.h"
#include "scoring/relocation/track.h"
#include "scoring/reorientation/track.h"

namespace myograde::scoring {

std::span<const ScoredTrack* const> ScoredTracks() {
  static const std::array all = {&ScoredManipulation(), &ScoredLocomotion(), &ScoredElbow(),
                                 &ScoredReorientation(), &ScoredBaoding(), &ScoredRelocation(),
                                 &ScoredChaseTag()};
  return all;
}

const ScoredTrack* FindScoredTrack(std::string_view name) {
  for (const ScoredTrack* track : ScoredTracks()) {
    if (track->name == name) return track;
  }
  return nullptr;
}

size_t RankedPlace(std::span<const Metric> metrics, size_t metric) {
  size_t place = 0;
  for (size_t i = 0; i < metric; ++i) place += metrics[i].ranked ? 1 : 0;
  return place;
}

}  // namespace myograde::scoring
