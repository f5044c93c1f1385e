// Makes the environment that a track config asks for.
#pragma once

#include <memory>
#include <string>

#include <absl/status/statusor.h>

#include "protocol/track_config.h"
#include "sim/environment.h"

namespace myograde::sim {

// `cache_dir` holds the challenge's models (see sim/model/model.h). Errors: the
// rules are wrong (InvalidArgumentError), or the model can't be loaded.
absl::StatusOr<std::unique_ptr<Environment>> MakeEnvironment(const TrackConfig& config,
                                                             const std::string& cache_dir);

}  // namespace myograde::sim
