// Builds a lease's order, the same way for everyone who plays one: the daemon's engine, its
// self-test, `myograde local` and replays.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "protocol/lease/lease.h"
#include "protocol/lease/policy_seed.h"

namespace myograde::server {

// What to run: a submission's program.
struct LeaseProgram {
  std::string artefact_dir;
  std::vector<std::string> command;
  std::map<std::string, std::string> environment;
  std::vector<std::string> runtimes;  // host folders
  std::string adapter = {};           // "": none
  bool extra_observations = false;    // see LeaseOrder
  std::optional<PolicyImage> image = {};
};

// Where to run it.
struct LeasePlace {
  int64_t slot = 0;
  int64_t uid = -1;       // of the slot; -1: the caller's own, or set by whoever starts the runner
  bool pinned = false;    // the slot is pinned to one processor
  std::string work_dir;
  std::string cache_dir;
  std::string log_dir;    // "": keep no logs
};

// Episodes `first` to `last` of an evaluation. REQUIRES: `seeds` covers them.
std::vector<EpisodeOrder> EpisodesOf(const TrackConfig& track, const std::vector<uint64_t>& seeds,
                                     const Form1PolicySeeds& form1, int64_t first, int64_t last);

// An order that plays a policy. `id` appears in messages and in the names of temporary files.
LeaseOrder MakeLeaseOrder(std::string id, const TrackConfig& track,
                          std::vector<EpisodeOrder> episodes, const LeaseProgram& program,
                          const LeasePlace& place);

// An order that replays logs, one file per episode.
LeaseOrder MakeReplayOrder(std::string id, const TrackConfig& track,
                           std::vector<EpisodeOrder> episodes, std::vector<std::string> logs,
                           const LeasePlace& place);

}  // namespace myograde::server
