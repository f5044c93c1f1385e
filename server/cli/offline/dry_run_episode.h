// One practice episode of a dry run, and what it says about the submission.
#pragma once

#include <cstdint>
#include <vector>

#include <nlohmann/json.hpp>

#include "server/cli/base/finding.h"
#include "server/cli/offline/local_run.h"

namespace myograde::server {

struct DryEpisode {
  std::vector<Finding> findings;
  nlohmann::json row;     // as `local` prints an episode; null if none was played
  nlohmann::json output;  // of the policy, an array as `local` prints it
  bool interrupted = false;
};

// Plays the first seed of `order` with every limit of the track, and compares what was used with the
// budgets, for an evaluation of so many `episodes`. What keeps this host from playing is a finding of the state kUnknown.
DryEpisode PlayDryEpisode(const LocalOrder& order, int64_t episodes);

}  // namespace myograde::server
