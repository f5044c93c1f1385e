// The descriptor of relocation.
#pragma once

#include "protocol/tracks/track_kind.h"

namespace myograde {

const TrackKind& RelocationTrack();

}  // namespace myograde
