// Replays episode logs through the runner and the simulator.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/lease/lease.h"

namespace myograde::server {

// Logs that one simulator plays in sequence.
struct ReplayBlock {
  std::vector<EpisodeOrder> episodes;
  std::vector<std::string> logs;  // one file per episode
  std::string trajectory = {};    // LeaseOrder::trajectory
};

struct ReplayOrder {
  TrackConfig track;
  std::vector<ReplayBlock> blocks;
  std::string work_dir;   // empty, owned by the caller
  std::string cache_dir;
  int64_t uid_base = -1;  // users of the slots; -1: the caller's own
  int slots = 1;
  bool background = false;  // gets little of processors that others want too
};

// Whether the state at the end of an episode is the next one's beginning, so that an episode can only
// be played after those before it in its lease.
bool CarriesOver(const TrackConfig& track);

struct ReplayHooks {
  std::function<void(int64_t done, int64_t total)> progress = [](int64_t, int64_t) {};
  std::function<bool()> stopped;
};

// The records of all episodes in block order. InternalError if the grader could not play them,
// CancelledError if `stopped`.
absl::StatusOr<std::vector<ReplayRecord>> RunReplay(const ReplayOrder& order,
                                                    const ReplayHooks& hooks);

}  // namespace myograde::server
