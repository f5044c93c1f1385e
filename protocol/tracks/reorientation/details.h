// What is measured in an episode of die reorientation besides its facts.
#pragma once

#include "protocol/tracks/hand_details.h"

namespace myograde {

struct ReorientationDetails : HandDetails {
  static constexpr std::string_view kTrack = "reorientation";
};

}  // namespace myograde
