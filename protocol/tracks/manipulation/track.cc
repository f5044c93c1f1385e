#include "protocol/tracks/manipulation/track.h"

namespace myograde {

const TrackKind& ManipulationTrack() {
  static const TrackKind track = {.name = ManipulationFacts::kTrack,
                                  .control_period_s = 0.01,
                                  .layout = ManipulationLayout,
                                  .no_facts = ManipulationFacts(),
                                  .max_steps = MaxStepsKey,
                                  .tables = nullptr,
                                  .template_year = 2024};
  return track;
}

}  // namespace myograde
