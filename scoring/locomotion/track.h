// What locomotion is judged and ranked by.
#pragma once

#include "protocol/base/config_reader.h"
#include "scoring/locomotion/judge.h"
#include "scoring/track.h"

namespace myograde::scoring {

const ScoredTrack& ScoredLocomotion();

// The judging of its `scoring` section, which ScoredLocomotion's parser reads too. The first
// mistake is the reader's.
LocomotionJudging ReadLocomotionJudging(ConfigReader& reader);

}  // namespace myograde::scoring
