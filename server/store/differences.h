// Compares two runs of one episode.
#pragma once

#include <string>
#include <vector>

#include "server/store/rows.h"

namespace myograde::server {

// The names of what differs, in this order: seed, outcome, reason, metrics, steps, sim_time,
// clipped, facts (everything else), digest. Values are compared bit for bit; what depends on the
// host's clock is left out.
std::vector<std::string> DifferencesBetween(const EpisodeRow& a, const EpisodeRow& b);

// A row's canonical bytes for the hash over an evaluation's results: index, seed, outcome, reason,
// metrics, steps and digest. With the salt of a config that hides its seeds
// (TrackConfig::seed_salt), "seed_commitment" takes the place of the seed; "" for all others.
std::string CanonicalResult(const EpisodeRow& row, const std::string& seed_salt);

}  // namespace myograde::server
