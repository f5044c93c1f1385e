// The descriptor of die reorientation.
#pragma once

#include "protocol/tracks/track_kind.h"

namespace myograde {

const TrackKind& ReorientationTrack();

}  // namespace myograde
