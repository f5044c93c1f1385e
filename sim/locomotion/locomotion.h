// The locomotion track's environment: a person with a prosthetic leg walks a course of 100 m.
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
absl::StatusOr<std::unique_ptr<Environment>> MakeLocomotion(const TrackConfig& config,
                                                            const std::string& cache_dir);

// The terms of the official reward, in the order of the official dictionary.
std::span<const RewardTerm> LocomotionRewardTerms();

}  // namespace myograde::sim
