// What pictures and replays show of an episode.
#include <algorithm>
#include <numbers>

#include <absl/strings/str_format.h>

#include "sim/model/official_steps.h"
#include "sim/reorientation/environment.h"
#include "sim/reorientation/reorientation.h"

namespace myograde::sim {
namespace reorientation {
namespace {

constexpr Series kSeries[] = {
    {"position_error", "Distance of the die from its place", "m"},
    {"rotation_error", "Angle that the die has still to turn", "deg"},
    {"effort", "Muscle effort (norm of the activations / 39)", ""},
};

class DieTelemetry final : public Telemetry {
 public:
  explicit DieTelemetry(const ReorientationEnvironment& environment) : environment_(environment) {}

  std::span<const Series> series() const override { return kSeries; }

  void Sample(std::span<double> out) const override {
    const auto& environment = static_cast<const Environment&>(environment_);
    const ReorientationEnvironment::Official now = environment_.official();
    const double values[] = {now.distance, now.turn * 180 / std::numbers::pi,
                             MuscleEffort(environment.model(), environment.data())};
    std::copy(std::begin(values), std::end(values), out.begin());
  }

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
  const ReorientationEnvironment& environment_;
  TargetEvents target_;
};

}  // namespace
}  // namespace reorientation

const CameraView& ReorientationView() {
  static const CameraView view = {.look_at = {-0.27, -0.53, 1.45}, .distance_m = 0.5,
                                  .azimuth_deg = 90, .elevation_deg = -45};
  return view;
}

std::vector<Reading> ReorientationReadings(const EpisodeFacts& episode) {
  const auto* facts = std::get_if<ReorientationFacts>(&episode.track);
  if (facts == nullptr) return {};
  const auto steps = static_cast<double>(std::max<int64_t>(episode.steps, 1));
  return {{"off its place", absl::StrFormat("%.3f m", facts->final_position_error)},
          {"still to turn", absl::StrFormat("%.2f rad", facts->final_rotation_error)},
          {"solved", absl::StrFormat("%d steps", facts->solved_steps)},
          {"mean effort", absl::StrFormat("%.4f", facts->effort_sum / steps)}};
}

std::unique_ptr<Telemetry> WatchReorientation(const Environment& environment) {
  return std::make_unique<reorientation::DieTelemetry>(
      static_cast<const ReorientationEnvironment&>(environment));
}

}  // namespace myograde::sim
