// A recorded episode that is played again to be shown.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "protocol/lease/track_config.h"
#include "protocol/log/episode_log.h"
#include "sim/environment.h"

namespace myograde::sim {

// The logs of one lease up to an episode, the last of which is shown.
class Recording {
 public:
  // Opens the files, and reads nothing of them. NotFoundError names the one that can't be opened.
  static absl::StatusOr<Recording> Open(const std::vector<std::string>& logs);

  // Reads the logs, which may come from anywhere. DataLossError: one is damaged, of another track
  // config than `track` (whose seeds don't matter), or has no step to show.
  absl::Status Read(const TrackConfig& track);

  // Of the log that is shown. REQUIRES: it was read.
  const EpisodeLog& log() const { return logs_.back(); }

  // Plays all logs in `environment`, which was not used before, and calls `on_step` after each
  // control step of the last one with the number of steps played, from 1; its first error ends the
  // calls. DataLossError: what is played is not what was recorded.
  absl::Status Play(Environment& environment,
                    const std::function<absl::Status(int64_t)>& on_step) const;

 private:
  std::vector<std::string> names_;
  std::vector<Fd> files_;
  std::vector<EpisodeLog> logs_;
};

}  // namespace myograde::sim
