// Relocation, for the registry: an arm and hand of 63 muscles carry a drawn object into a bin.
#pragma once

#include <absl/status/statusor.h>

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "protocol/lease/track_config.h"
#include "sim/environment.h"
#include "sim/model/source.h"
#include "sim/reading.h"
#include "sim/render/camera_view.h"
#include "sim/trajectory/telemetry.h"

namespace myograde::sim {

const ModelSource& RelocationModel();

// Across the table, at the arm with the object and the bin.
const CameraView& RelocationView();

// Errors: the config's rules are wrong (InvalidArgumentError), the model can't
// be loaded (see LoadModel).
absl::StatusOr<std::unique_ptr<Environment>> MakeRelocation(const TrackConfig& config,
                                                            const std::string& cache_dir);

// The terms of the official reward, in the order of the official dictionary.
std::span<const RewardTerm> RelocationRewardTerms();

// What pictures say about an episode; empty if the facts are of another track.
std::vector<Reading> RelocationReadings(const EpisodeFacts& episode);

// What a replay shows besides the bodies. REQUIRES: an environment of MakeRelocation, which
// outlives the telemetry.
std::unique_ptr<Telemetry> WatchRelocation(const Environment& environment);

}  // namespace myograde::sim
