// The descriptor of relocation.
#pragma once

#include "protocol/tracks/track_kind.h"

namespace myograde {

const TrackKind& RelocationTrack();

// The tables behind its layout (layout.cc): the official observation, part by part in official
// order.
const TrackLayout& RelocationLayout();

}  // namespace myograde
