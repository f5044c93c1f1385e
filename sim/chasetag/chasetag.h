// Chase-tag, for the registry: a person of 80 muscles chases an opponent or evades it.
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

const ModelSource& ChaseTagModel();

// Moves along with the person.
const CameraView& ChaseTagView();

// Errors: the config's rules are wrong (InvalidArgumentError), the model can't
// be loaded (see LoadModel).
absl::StatusOr<std::unique_ptr<Environment>> MakeChaseTag(const TrackConfig& config,
                                                          const std::string& cache_dir);

// The terms of the official reward, in the order of the official dictionary.
std::span<const RewardTerm> ChaseTagRewardTerms();

// What pictures say about an episode; empty if the facts are of another track.
std::vector<Reading> ChaseTagReadings(const EpisodeFacts& episode);

// What a replay shows besides the bodies. REQUIRES: an environment of MakeChaseTag, which outlives
// the telemetry.
std::unique_ptr<Telemetry> WatchChaseTag(const Environment& environment);

}  // namespace myograde::sim
