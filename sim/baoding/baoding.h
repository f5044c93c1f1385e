// Baoding balls, for the registry: a hand of 39 muscles moves two balls on its palm after two
// targets that circle each other.
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

const ModelSource& BaodingModel();

// From the front and above, at the palm with the balls.
const CameraView& BaodingView();

// Errors: the config's rules are wrong (InvalidArgumentError), the model can't
// be loaded (see LoadModel).
absl::StatusOr<std::unique_ptr<Environment>> MakeBaoding(const TrackConfig& config,
                                                         const std::string& cache_dir);

// The terms of the official reward, in the order of the official dictionary.
std::span<const RewardTerm> BaodingRewardTerms();

// What pictures say about an episode; empty if the facts are of another track.
std::vector<Reading> BaodingReadings(const EpisodeFacts& episode);

// What a replay shows besides the bodies. REQUIRES: an environment of MakeBaoding, which outlives
// the telemetry.
std::unique_ptr<Telemetry> WatchBaoding(const Environment& environment);

}  // namespace myograde::sim
