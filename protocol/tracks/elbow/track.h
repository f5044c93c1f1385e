// The descriptor of elbow.
#pragma once

#include "protocol/tracks/track_kind.h"

namespace myograde {

const TrackKind& ElbowTrack();

// The tables behind its layout (layout.cc): the official observation, part by part in official
// order.
const TrackLayout& ElbowLayout();

}  // namespace myograde
