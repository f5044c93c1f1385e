// What die reorientation is judged and ranked by.
#pragma once

#include "scoring/score.h"

namespace myograde::scoring {

// Its own metrics are the position error at the end in m, and the rotation error in rad.
const ScoredTrack& ScoredReorientation();

}  // namespace myograde::scoring
