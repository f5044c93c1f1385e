// How an episode of a hand's track ends early: what it holds is lost.
#pragma once

#include "protocol/base/outcome.h"

namespace myograde {

struct DroppedEnd {
  static constexpr EpisodeEnd kDropped{"dropped"};
};

struct DroppedReason {
  static constexpr FailureReason kDropped{"dropped"};
};

}  // namespace myograde
