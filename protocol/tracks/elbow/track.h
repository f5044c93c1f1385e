// The descriptor of elbow.
#pragma once

#include "protocol/tracks/track_kind.h"

namespace myograde {

const TrackKind& ElbowTrack();

// The tables behind its layout (layout.cc): the observation is the official one, part by part in
// its order.
const TrackLayout& ElbowLayout();

}  // namespace myograde
