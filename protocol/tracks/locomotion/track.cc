#include "protocol/tracks/locomotion/track.h"

#include <cmath>

#include "protocol/base/config_reader.h"

namespace myograde {
namespace locomotion {
namespace {

constexpr double kControlPeriod = 0.005;  // s

absl::StatusOr<int64_t> MaxSteps(const nlohmann::json& rules) {
  ConfigReader reader(rules, "rules");
  ConfigReader end(reader.Object("end"), "rules: end");
  const double limit = end.Number("time_limit_s", {kControlPeriod, 3600});
  for (const ConfigReader* part : {&reader, &end}) {
    if (!part->mistake().ok()) return part->mistake();
  }
  return std::llround(limit / kControlPeriod);
}

}  // namespace
}  // namespace locomotion

const TrackKind& LocomotionTrack() {
  static const TrackKind track = {.name = LocomotionFacts::kTrack,
                                  .control_period_s = locomotion::kControlPeriod,
                                  .layout = LocomotionLayout,
                                  .no_facts = LocomotionFacts(),
                                  .max_steps = locomotion::MaxSteps,
                                  .tables = LegSetTables,
                                  .template_year = 2024};
  return track;
}

}  // namespace myograde
