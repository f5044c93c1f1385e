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

// The logs of one lease up to an episode; any of them may be shown.
class Recording {
 public:
  // Opens the files, and reads nothing of them. NotFoundError names the one that can't be opened.
  static absl::StatusOr<Recording> Open(const std::vector<std::string>& logs);

  // Whether these logs, in this order, are the first of its own.
  bool BeginsWith(const std::vector<std::string>& logs) const;

  // Reads the logs, which may come from anywhere. DataLossError: one is damaged, or of another track
  // config than `track` (whose seeds don't matter).
  absl::Status Read(const TrackConfig& track);

  // The log `at`, from 0. REQUIRES: it was read.
  const EpisodeLog& log(size_t at) const { return logs_[at]; }

  // Plays all logs in `environment`, which was not used before, and calls `on_step` after each
  // control step with the log that it is of and the number of its steps played, from 1; its first
  // error ends the calls. DataLossError: what is played is not what was recorded.
  absl::Status Play(Environment& environment,
                    const std::function<absl::Status(size_t, int64_t)>& on_step) const;

 private:
  std::vector<std::string> names_;
  std::vector<Fd> files_;
  std::vector<EpisodeLog> logs_;
};

}  // namespace myograde::sim
