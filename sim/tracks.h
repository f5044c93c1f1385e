// The registry of the simulated tracks.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/lease/track_config.h"
#include "sim/environment.h"
#include "sim/model/source.h"
#include "sim/reading.h"
#include "sim/render/camera_view.h"
#include "sim/trajectory/telemetry.h"

namespace myograde::sim {

// What the simulator has of a track; its folder is sim/<track>/.
struct SimulatedTrack {
  const TrackKind* kind;
  const ModelSource* model;
  const CameraView* view;  // of pictures, unless another is asked for
  absl::StatusOr<std::unique_ptr<Environment>> (*make)(const TrackConfig& config,
                                                       const std::string& cache_dir);
  std::span<const RewardTerm> reward_terms;  // in the order of Environment::RewardTerms
  std::vector<Reading> (*readings)(const EpisodeFacts& episode);  // of the episode so far
  MakeTelemetry telemetry;  // of one of its environments
};

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
