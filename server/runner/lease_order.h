// Builds a lease's order, the same way for everyone who plays one: the daemon's engine, its
// self-test, `myograde local` and replays.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "protocol/lease/lease.h"
#include "protocol/lease/policy_seed.h"

namespace myograde::server {

// Episodes `first` to `last` of an evaluation. REQUIRES: `seeds` covers them.
std::vector<EpisodeOrder> EpisodesOf(const TrackConfig& track, const std::vector<uint64_t>& seeds,
                                     int64_t first, int64_t last);

// An order that plays a policy. `id` appears in messages and in the names of temporary files.
LeaseOrder MakeLeaseOrder(std::string id, const TrackConfig& track,
                          std::vector<EpisodeOrder> episodes, const LeaseProgram& program,
                          const LeasePlace& place);

// An order that replays logs, one file per episode.
LeaseOrder MakeReplayOrder(std::string id, const TrackConfig& track,
                           std::vector<EpisodeOrder> episodes, std::vector<std::string> logs,
                           const LeasePlace& place);

}  // namespace myograde::server
