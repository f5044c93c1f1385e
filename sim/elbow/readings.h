// What pictures of an episode say about it.
#pragma once

#include <vector>

#include "protocol/tracks/episode_facts.h"
#include "sim/reading.h"

namespace myograde::sim {

// Empty if the facts are of another track.
std::vector<Reading> ElbowReadings(const EpisodeFacts& episode);

}  // namespace myograde::sim
