// What is measured in an episode of relocation besides its facts.
#pragma once

#include "protocol/tracks/arm.h"
#include "protocol/tracks/hand_details.h"

namespace myograde {

struct RelocationDetails : FlaggedDetails<kArmJointNames> {
  static constexpr std::string_view kTrack = "relocation";
};

}  // namespace myograde
