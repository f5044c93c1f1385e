// What pictures and replays show of an episode.
#include <absl/strings/str_format.h>

#include <algorithm>

#include "sim/model/official_steps.h"
#include "sim/relocation/environment.h"
#include "sim/relocation/relocation.h"

namespace myograde::sim {
namespace relocation {
namespace {

constexpr Series kSeries[] = {
    {"position_error", "Distance of the object from the goal", "m"},
    {"reach", "Distance of the object from the palm", "m"},
    {"effort", "Muscle effort (norm of the activations / 63)", ""},
};

class ObjectTelemetry final : public Telemetry {
 public:
  explicit ObjectTelemetry(const RelocationEnvironment& environment) : environment_(environment) {}

  std::span<const Series> series() const override { return kSeries; }

  void Sample(std::span<double> out) const override {
    const auto& environment = static_cast<const Environment&>(environment_);
    const RelocationEnvironment::Official now = environment_.official();
    const double values[] = {now.distance, now.reach,
                             MuscleEffort(environment.model(), environment.data())};
    std::copy(std::begin(values), std::end(values), out.begin());
  }

  std::string_view Legend() const override { return "The goal is in the bin."; }

  void AfterStep(double time_s, std::vector<TrajectoryEvent>& events) override {
    target_.Add(environment_.official().solved, time_s, "The object is at the goal",
                "The object has left the goal", events);
  }

 private:
  const RelocationEnvironment& environment_;
  TargetEvents target_;
};

}  // namespace
}  // namespace relocation

const CameraView& RelocationView() {
  static const CameraView view = {
      .look_at = {-0.22, -0.25, 1.08}, .distance_m = 1.1, .azimuth_deg = 90, .elevation_deg = -30};
  return view;
}

std::vector<Reading> RelocationReadings(const EpisodeFacts& episode) {
  const auto* facts = std::get_if<RelocationFacts>(&episode.track);
  if (facts == nullptr) return {};
  const auto steps = static_cast<double>(std::max<int64_t>(episode.steps, 1));
  return {{"off the goal", absl::StrFormat("%.3f m", facts->final_position_error)},
          {"off the palm", absl::StrFormat("%.3f m", facts->final_reach)},
          {"solved", absl::StrFormat("%d steps", facts->solved_steps)},
          {"mean effort", absl::StrFormat("%.4f", facts->effort_sum / steps)}};
}

std::unique_ptr<Telemetry> WatchRelocation(const Environment& environment) {
  return std::make_unique<relocation::ObjectTelemetry>(
      static_cast<const RelocationEnvironment&>(environment));
}

}  // namespace myograde::sim
