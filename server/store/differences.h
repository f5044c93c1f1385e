// Comparing two playings of one episode.
#pragma once

#include <string>
#include <vector>

#include "server/store/rows.h"

namespace myograde::server {

// Names of what differs, in this order: seed, outcome, reason, metrics, steps,
// sim_time, clipped, facts (all that is left), digest. Values are compared bit
// for bit; what the host's clock decides is left out.
std::vector<std::string> DifferencesBetween(const EpisodeRow& a, const EpisodeRow& b);

// The canonical bytes of a row for the hash over an evaluation's results:
// index, seed, outcome, reason, metrics, steps and digest.
std::string CanonicalResult(const EpisodeRow& row);

}  // namespace myograde::server
