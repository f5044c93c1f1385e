// The elbow track's environment: six muscles bring an elbow to a drawn angle and hold it there.
#pragma once

#include <memory>
#include <string>

#include <absl/status/statusor.h>

#include "protocol/lease/track_config.h"
#include "sim/environment.h"

namespace myograde::sim {

// Errors: the config's rules are wrong (InvalidArgumentError), the model can't
// be loaded (see LoadModel).
absl::StatusOr<std::unique_ptr<Environment>> MakeElbow(const TrackConfig& config,
                                                       const std::string& cache_dir);

}  // namespace myograde::sim
