#include "protocol/tracks/manipulation/track.h"

namespace myograde {

const TrackKind& ManipulationTrack() {
  static const TrackKind track = {.name = ManipulationFacts::kTrack,
                                  .control_period_s = 0.01,
                                  .layout = ManipulationLayout,
                                  .no_facts = ManipulationFacts(),
                                  .max_steps = MaxStepsKey,
                                  .tables = nullptr,
                                  .in_template_2024 = true};
  return track;
}

}  // namespace myograde
