// Manipulation, for the registry: the muscle arm hands an object over to the prosthesis, which
// places it on the goal pillar.
#pragma once

#include "sim/track.h"

namespace myograde::sim {

SimulatedTrack SimulatedManipulation();
const ModelSource& ManipulationModel();

// As MakeOf; InvalidArgumentError also if the config has fewer episodes per lease than its rules
// need.
absl::StatusOr<std::unique_ptr<Environment>> MakeManipulation(const TrackConfig& config,
                                                              const std::string& cache_dir);

}  // namespace myograde::sim
