// The descriptor of locomotion.
#pragma once

#include "protocol/tracks/track_kind.h"

namespace myograde {

const TrackKind& LocomotionTrack();

// The parameter sets of the leg under a config's rules (leg_set_tables.cc).
std::vector<RulesTable> LegSetTables(const nlohmann::json& rules);

// The tables behind its layout (layout.cc).
const TrackLayout& LocomotionLayout();

}  // namespace myograde
