// What is measured in an episode of Baoding balls besides its facts.
#pragma once

#include "protocol/tracks/hand_details.h"

namespace myograde {

struct BaodingDetails : HandDetails {
  static constexpr std::string_view kTrack = "baoding";
};

}  // namespace myograde
