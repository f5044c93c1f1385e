// The descriptor of chase-tag.
#pragma once

#include "protocol/tracks/track_kind.h"

namespace myograde {

const TrackKind& ChaseTagTrack();

}  // namespace myograde
