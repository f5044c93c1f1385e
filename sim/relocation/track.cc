#include "sim/relocation/track.h"

#include <absl/strings/str_format.h>

#include "protocol/tracks/relocation/track.h"
#include "sim/model/hand.h"
#include "sim/relocation/environment.h"
#include "sim/relocation/pins.h"

namespace myograde::sim {
namespace relocation {
namespace {

constexpr Series kSeries[] = {
    {"position_error", "Distance of the object from the goal", "m"},
    {"reach", "Distance of the object from the palm", "m"},
    {"effort", "Muscle effort (norm of the activations / 63)", ""},
};

class ObjectTelemetry final : public TelemetryOf<RelocationEnvironment, kSeries> {
 public:
  using TelemetryOf::TelemetryOf;

  std::string_view Legend() const override { return "The goal is in the bin."; }

  void AfterStep(double time_s, std::vector<TrajectoryEvent>& events) override {
    target_.Add(environment_.official().solved, time_s, "The object is at the goal",
                "The object has left the goal", events);
  }

 private:
  std::array<double, std::size(kSeries)> Values() const override {
    const RelocationEnvironment::Official now = environment_.official();
    return {now.distance, now.reach, Effort()};
  }

  TargetEvents target_;
};

std::vector<Reading> Readings(const RelocationFacts& facts, double) {
  return {{"off the goal", absl::StrFormat("%.3f m", facts.final_position_error)},
          {"off the palm", absl::StrFormat("%.3f m", facts.final_reach)},
          {"solved", absl::StrFormat("%d steps", facts.solved_steps)}};
}

}  // namespace
}  // namespace relocation

const ModelSource& RelocationModel() {
  static const ModelSource source = {
      .name = "relocation",
      .pins = relocation::kPins,
      .main_file = "envs/myo/assets/arm/myoarm_relocate.xml",
      .actuator_file = "simhive/myo_sim/arm/assets/myoarm_assets.xml",
      .inertials = kHandInertials,
      .buffers = {1000, 400, 1'000'000}};
  return source;
}

SimulatedTrack SimulatedRelocation() {
  return {.kind = &RelocationTrack(),
          .model = &RelocationModel(),
          // Across the table, at the arm with the object and the bin.
          .view = {.look_at = {-0.22, -0.25, 1.08},
                   .distance_m = 1.1,
                   .azimuth_deg = 90,
                   .elevation_deg = -30},
          .make = MakeOf<RelocationEnvironment, ParseRelocationRules, RelocationModel>,
          .reward_terms = RelocationEnvironment::kRewardTerms,
          .readings = ReadingsOf<RelocationFacts, relocation::Readings>,
          .telemetry = WatchBy<relocation::ObjectTelemetry>};
}

}  // namespace myograde::sim
