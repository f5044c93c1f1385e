#include "protocol/tracks/elbow/track.h"

namespace myograde {

const TrackKind& ElbowTrack() {
  static const TrackKind track = {.name = ElbowFacts::kTrack,
                                  .control_period_s = 0.02,
                                  .layout = ElbowLayout,
                                  .no_facts = ElbowFacts(),
                                  .max_steps = MaxStepsKey,
                                  .tables = nullptr};
  return track;
}

}  // namespace myograde
