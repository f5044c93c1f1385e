#include "protocol/tracks/manipulation/track.h"

#include "protocol/base/config_reader.h"

namespace myograde {
namespace manipulation {
namespace {

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
                                  .max_steps = MaxStepsKey,
                                  .tables = nullptr,
                                  .upgrade = manipulation::Upgrade,
                                  .in_template_2024 = true};
  return track;
}

}  // namespace myograde
