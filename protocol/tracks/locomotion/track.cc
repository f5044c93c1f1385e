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

void Upgrade(int64_t form, nlohmann::json& config) {
  if (form != 1) return;
  GiveKey(config, "/rules/course/mixed_at_least", 0);
  GiveKey(config, "/rules/leg/parameter_sets", nlohmann::json::array());
  GiveKey(config, "/scoring/boards/main/distance_band", 0);
  GiveKey(config, "/scoring/boards/physiological/means", "episodes");
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
                                  .upgrade = locomotion::Upgrade,
                                  .in_template_2024 = true};
  return track;
}

}  // namespace myograde
