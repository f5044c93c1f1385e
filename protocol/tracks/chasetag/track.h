// The descriptor of chase-tag.
#pragma once

#include "protocol/tracks/track_kind.h"

namespace myograde {

const TrackKind& ChaseTagTrack();

// The tables behind its layout (layout.cc): the official observation, part by part in official
// order.
const TrackLayout& ChaseTagLayout();

}  // namespace myograde
