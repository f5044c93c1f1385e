// What is measured in an episode of chase-tag besides its facts.
#pragma once

#include "protocol/tracks/chasetag/legs.h"
#include "protocol/tracks/hand_details.h"

namespace myograde {

struct ChaseTagDetails : FlaggedDetails<kLegsJointNames> {
  static constexpr std::string_view kTrack = "chasetag";
};

}  // namespace myograde
