// What is measured in an episode besides its facts (protocol/tracks/details.h).
#pragma once

#include <optional>
#include <variant>

#include "protocol/tracks/baoding/details.h"
#include "protocol/tracks/chasetag/details.h"
#include "protocol/tracks/elbow/details.h"
#include "protocol/tracks/locomotion/details.h"
#include "protocol/tracks/manipulation/details.h"
#include "protocol/tracks/relocation/details.h"
#include "protocol/tracks/reorientation/details.h"

namespace myograde {

// The registry of details: one alternative per track, in the order of TrackFacts.
using TrackDetails =
    std::variant<ManipulationDetails, LocomotionDetails, ElbowDetails, ReorientationDetails,
                 BaodingDetails, RelocationDetails, ChaseTagDetails>;

// None: no step was played, or the record is of an earlier version.
using EpisodeDetails = std::optional<TrackDetails>;

}  // namespace myograde
