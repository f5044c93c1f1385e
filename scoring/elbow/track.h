// What elbow is judged and ranked by.
#pragma once

#include "scoring/track.h"

namespace myograde::scoring {

const ScoredTrack& ScoredElbow();

}  // namespace myograde::scoring
