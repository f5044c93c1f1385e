// The descriptor of Baoding balls.
#pragma once

#include "protocol/tracks/track_kind.h"

namespace myograde {

const TrackKind& BaodingTrack();

// The tables behind its layout (layout.cc): the official observation, part by part in official
// order.
const TrackLayout& BaodingLayout();

}  // namespace myograde
