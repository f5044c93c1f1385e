// Looks on while an episode is played again from its log, and makes a file of what it saw.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include <absl/status/statusor.h>

#include "protocol/log/episode_log.h"

namespace myograde::sim {

class EpisodeRecorder {
 public:
  virtual ~EpisodeRecorder() = default;

  // The environment is in the state of the episode's first observation.
  virtual void Begin() = 0;
  // It has played a step.
  virtual void AfterStep() = 0;
  // The file. Call once, after the last step. ResourceExhaustedError: it would be too large.
  virtual absl::StatusOr<std::string> Finish() = 0;
};

// Makes the recorder of a log's episode. An error says why the episode can't be recorded.
using MakeEpisodeRecorder =
    std::function<absl::StatusOr<std::unique_ptr<EpisodeRecorder>>(const EpisodeLog& log)>;

}  // namespace myograde::sim
