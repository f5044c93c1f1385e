#include "sim/reorientation/track.h"

#include <absl/strings/str_format.h>

#include <numbers>

#include "protocol/tracks/reorientation/track.h"
#include "sim/reorientation/environment.h"

namespace myograde::sim {
namespace reorientation {
namespace {

constexpr Series kSeries[] = {
    {"position_error", "Distance of the die from its place", "m"},
    {"rotation_error", "Angle that the die has still to turn", "deg"},
    {"effort", "Muscle effort (norm of the activations / 39)", ""},
};

class DieTelemetry final : public TelemetryOf<ReorientationEnvironment, kSeries> {
 public:
  using TelemetryOf::TelemetryOf;

  std::string_view Legend() const override { return "The die beside the hand shows the goal."; }

  void AfterStep(double time_s, std::vector<TrajectoryEvent>& events) override {
    target_.Add(environment_.official().solved, time_s, "The die is as the goal shows it",
                "The die has left the goal", events);
  }

  std::array<double, 3> ScaleOf(int body) const override {
    const DieScene& scene = environment_.scene();
    if (body != scene.die_body && body != scene.goal_body) return {1, 1, 1};
    const double nominal = scene.sizes.back();  // the last box is widest along its last axis
    const double scale = 1 + environment_.variation().size_change / nominal;
    return {scale, scale, scale};
  }

 private:
  std::array<double, std::size(kSeries)> Values() const override {
    const ReorientationEnvironment::Official now = environment_.official();
    return {now.distance, now.turn * 180 / std::numbers::pi, Effort()};
  }

  TargetEvents target_;
};

std::vector<Reading> Readings(const ReorientationFacts& facts, double) {
  return {{"off its place", absl::StrFormat("%.3f m", facts.final_position_error)},
          {"still to turn", absl::StrFormat("%.2f rad", facts.final_rotation_error)},
          {"solved", absl::StrFormat("%d steps", facts.solved_steps)}};
}

}  // namespace
}  // namespace reorientation

SimulatedTrack SimulatedReorientation() {
  return {.kind = &ReorientationTrack(),
          .model = &ReorientationModel(),
          // From the front and above, at the palm with the die and the goal beside it.
          .view = {.look_at = {-0.27, -0.53, 1.45},
                   .distance_m = 0.5,
                   .azimuth_deg = 90,
                   .elevation_deg = -45},
          .make = MakeOf<ReorientationEnvironment, ParseReorientationRules, ReorientationModel>,
          .reward_terms = ReorientationEnvironment::kRewardTerms,
          .readings = ReadingsOf<ReorientationFacts, reorientation::Readings>,
          .telemetry = WatchBy<reorientation::DieTelemetry>};
}

}  // namespace myograde::sim
