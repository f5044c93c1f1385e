#include "protocol/tracks/elbow/track.h"

#include "protocol/base/config_reader.h"

namespace myograde {
namespace elbow {
namespace {

absl::StatusOr<int64_t> MaxSteps(const nlohmann::json& rules) {
  ConfigReader reader(rules, "rules");
  const int64_t steps = reader.Integer("max_steps", 1, 1'000'000);
  if (!reader.mistake().ok()) return reader.mistake();
  return steps;
}

}  // namespace
}  // namespace elbow

const TrackKind& ElbowTrack() {
  static const TrackKind track = {.name = ElbowFacts::kTrack,
                                  .control_period_s = 0.02,
                                  .layout = ElbowLayout,
                                  .no_facts = ElbowFacts(),
                                  .max_steps = elbow::MaxSteps,
                                  .tables = nullptr,
                                  // It began with form 2.
                                  .upgrade = nullptr};
  return track;
}

}  // namespace myograde
