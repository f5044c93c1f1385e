// The descriptor of manipulation.
#pragma once

#include "protocol/tracks/track_kind.h"

namespace myograde {

const TrackKind& ManipulationTrack();

// The tables behind its layout (layout.cc).
const TrackLayout& ManipulationLayout();

}  // namespace myograde
