// The elbow track's environment: six muscles bring an elbow to a drawn angle and hold it there.
#pragma once

#include <memory>
#include <span>
#include <string>

#include <absl/status/statusor.h>

#include "protocol/lease/track_config.h"
#include "sim/environment.h"

namespace myograde::sim {

// Errors: the config's rules are wrong (InvalidArgumentError), the model can't
// be loaded (see LoadModel).
absl::StatusOr<std::unique_ptr<Environment>> MakeElbow(const TrackConfig& config,
                                                       const std::string& cache_dir);

// The terms of the official reward, in the order of the official dictionary.
std::span<const RewardTerm> ElbowRewardTerms();

}  // namespace myograde::sim
