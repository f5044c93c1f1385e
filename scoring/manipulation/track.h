// What manipulation is judged and ranked by.
#pragma once

#include "protocol/base/config_reader.h"
#include "scoring/manipulation/judge.h"
#include "scoring/track.h"

namespace myograde::scoring {

const ScoredTrack& ScoredManipulation();

// The judging of its `scoring` section, which ScoredManipulation's parser reads too. The first
// mistake is the reader's.
ManipulationJudging ReadManipulationJudging(ConfigReader& reader);

}  // namespace myograde::scoring
