// The descriptor of Baoding balls.
#pragma once

#include "protocol/tracks/track_kind.h"

namespace myograde {

const TrackKind& BaodingTrack();

}  // namespace myograde
