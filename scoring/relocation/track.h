// What relocation is judged and ranked by.
#pragma once

#include "scoring/score.h"

namespace myograde::scoring {

// Its own metrics are the position error at the end in m, and the reach in m, from the object to
// the palm.
const ScoredTrack& ScoredRelocation();

}  // namespace myograde::scoring
