// Die reorientation, for the registry: a hand of 39 muscles turns a die on its palm to a drawn
// orientation and place.
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

const ModelSource& ReorientationModel();

// From the front and above, at the palm with the die and the goal beside it.
const CameraView& ReorientationView();

// Errors: the config's rules are wrong (InvalidArgumentError), the model can't
// be loaded (see LoadModel).
absl::StatusOr<std::unique_ptr<Environment>> MakeReorientation(const TrackConfig& config,
                                                               const std::string& cache_dir);

// The terms of the official reward, in the order of the official dictionary.
std::span<const RewardTerm> ReorientationRewardTerms();

// What pictures say about an episode; empty if the facts are of another track.
std::vector<Reading> ReorientationReadings(const EpisodeFacts& episode);

// What a replay shows besides the bodies. REQUIRES: an environment of MakeReorientation, which
// outlives the telemetry.
std::unique_ptr<Telemetry> WatchReorientation(const Environment& environment);

}  // namespace myograde::sim
