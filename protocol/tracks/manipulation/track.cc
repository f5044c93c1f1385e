#include "protocol/tracks/manipulation/track.h"

#include "protocol/base/config_reader.h"

namespace myograde {
namespace manipulation {
namespace {

absl::StatusOr<int64_t> MaxSteps(const nlohmann::json& rules) {
  ConfigReader reader(rules, "rules");
  const int64_t steps = reader.Integer("max_steps", 1, 1'000'000);
  if (!reader.mistake().ok()) return reader.mistake();
  return steps;
}

void Upgrade(int64_t form, nlohmann::json& config) {
  if (form != 1) return;
  GiveKey(config, "/rules/torso_contact", "arm");
  GiveKey(config, "/scoring/phantom_reason", "handover");
  GiveKey(config, "/scoring/boards/main/ties", "acceptance");
}

}  // namespace
}  // namespace manipulation

const TrackKind& ManipulationTrack() {
  static const TrackKind track = {.name = ManipulationFacts::kTrack,
                                  .control_period_s = 0.01,
                                  .layout = ManipulationLayout,
                                  .no_facts = ManipulationFacts(),
                                  .max_steps = manipulation::MaxSteps,
                                  .tables = nullptr,
                                  .upgrade = manipulation::Upgrade};
  return track;
}

}  // namespace myograde
