// The registry of the simulated tracks.
#pragma once

#include <absl/status/statusor.h>

#include <memory>
#include <span>
#include <string>

#include "sim/track.h"

namespace myograde::sim {

std::span<const SimulatedTrack> SimulatedTracks();

// REQUIRES: the kind of a parsed config.
const SimulatedTrack& FindSimulatedTrack(const TrackKind& kind);

// Makes the environment that a track config asks for. `cache_dir` holds the
// challenge's models (see sim/model/model.h). Errors: the rules are wrong
// (InvalidArgumentError), or the model can't be loaded.
absl::StatusOr<std::unique_ptr<Environment>> MakeEnvironment(const TrackConfig& config,
                                                             const std::string& cache_dir);

// Compiles and stores the models of all tracks (`myograde-sim --compile-models`).
absl::Status CompileModels(const std::string& cache_dir);

}  // namespace myograde::sim
