// The descriptor of die reorientation.
#pragma once

#include "protocol/tracks/track_kind.h"

namespace myograde {

const TrackKind& ReorientationTrack();

// The tables behind its layout (layout.cc): the official observation, part by part in official
// order.
const TrackLayout& ReorientationLayout();

}  // namespace myograde
