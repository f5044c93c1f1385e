// The order of a lease, put together the same way by all who play one: the daemon's engine, its
// self-test, `myograde local` and replays.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "protocol/lease/lease.h"
#include "protocol/lease/policy_seed.h"

namespace myograde::server {

// What is run: a submission's program.
struct LeaseProgram {
  std::string artefact_dir;
  std::vector<std::string> command;
  std::map<std::string, std::string> environment;
  std::vector<std::string> runtimes;  // host folders
};

// Where it is run.
struct LeasePlace {
  int64_t slot = 0;
  int64_t uid = -1;       // of the slot; -1: the caller's own, or whoever starts the runner says
  bool pinned = false;    // the slot keeps to one processor
  std::string work_dir;
  std::string cache_dir;
  std::string log_dir;    // "": no logs are kept
};

// Episodes `first` to `last` of an evaluation. REQUIRES: `seeds` has them.
std::vector<EpisodeOrder> EpisodesOf(const TrackConfig& track, const std::vector<uint64_t>& seeds,
                                     const Form1PolicySeeds& form1, int64_t first, int64_t last);

// Plays a policy. `id` is for messages and the names of temporary things.
LeaseOrder MakeLeaseOrder(std::string id, const TrackConfig& track,
                          std::vector<EpisodeOrder> episodes, const LeaseProgram& program,
                          const LeasePlace& place);

// Plays logs again, a file for each episode.
LeaseOrder MakeReplayOrder(std::string id, const TrackConfig& track,
                           std::vector<EpisodeOrder> episodes, std::vector<std::string> logs,
                           const LeasePlace& place);

}  // namespace myograde::server
