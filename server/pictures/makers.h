// Makes what viewers show of an episode: each by programs of the grader that keep a log's hostile bytes
// to themselves, at the lowest priority.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/lease/lease.h"

namespace myograde::server {

// An episode to show, as the store knows it.
struct PicturedEpisode {
  TrackConfig track;                   // that it was played under
  std::vector<EpisodeOrder> episodes;  // it is the last; before it those that it can't be played without
  std::vector<std::string> logs;       // a file for each
};

struct MakerOptions {
  std::string work_dir;   // made and removed again by each maker
  std::string cache_dir;
  int64_t uid = -1;       // of the sandbox; -1: the caller's own
};

// Errors of all makers: DataLossError, the episode can't be shown, and trying again changes nothing;
// CancelledError, `stopped`; any other, the host is in trouble.
using Stopped = std::function<bool()>;

// The trajectory file (sim/trajectory/README.md).
absl::StatusOr<std::string> MakeTrajectory(const PicturedEpisode& episode,
                                           const MakerOptions& options, const Stopped& stopped);

// A PNG of 320 by 180 pixels.
absl::StatusOr<std::string> MakePicture(const PicturedEpisode& episode, const MakerOptions& options,
                                        const Stopped& stopped);

// The model file of a track.
absl::StatusOr<std::string> MakeModel(const std::string& track, const MakerOptions& options,
                                      const Stopped& stopped);

}  // namespace myograde::server
