// What pictures and replays show of an episode.
#include <algorithm>

#include <absl/strings/str_format.h>

#include "sim/baoding/baoding.h"
#include "sim/baoding/environment.h"
#include "sim/model/official_steps.h"

namespace myograde::sim {
namespace baoding {
namespace {

constexpr Series kSeries[] = {
    {"distance_1", "Distance of the yellow ball from its target", "m"},
    {"distance_2", "Distance of the pink ball from its target", "m", {}, "distance_1"},
    {"effort", "Muscle effort (norm of the activations / 39)", ""},
};

class BallTelemetry final : public Telemetry {
 public:
  explicit BallTelemetry(const BaodingEnvironment& environment) : environment_(environment) {}

  std::span<const Series> series() const override { return kSeries; }

  void Sample(std::span<double> out) const override {
    const auto& environment = static_cast<const Environment&>(environment_);
    const BaodingEnvironment::Official now = environment_.official();
    const double values[] = {now.distances[0], now.distances[1],
                             MuscleEffort(environment.model(), environment.data())};
    std::copy(std::begin(values), std::end(values), out.begin());
  }

  std::string_view Legend() const override {
    return "The small balls are the targets of the large ones.";
  }

  void AfterStep(double time_s, std::vector<TrajectoryEvent>& events) override {
    target_.Add(environment_.official().solved, time_s, "Both balls are at their targets",
                "A ball has left its target", events);
  }

  std::array<double, 3> ScaleOf(int body) const override {
    double scale = 1;
    for (size_t i = 0; i < 2; ++i) {
      if (body != environment_.scene().bodies[i]) continue;
      scale = environment_.variation().sizes[i] / environment_.scene().size;
    }
    return {scale, scale, scale};
  }

 private:
  const BaodingEnvironment& environment_;
  TargetEvents target_;
};

}  // namespace
}  // namespace baoding

const CameraView& BaodingView() {
  static const CameraView view = {
      .look_at = {-0.24, -0.53, 1.45}, .distance_m = 0.5, .azimuth_deg = 90, .elevation_deg = -45};
  return view;
}

std::vector<Reading> BaodingReadings(const EpisodeFacts& episode) {
  const auto* facts = std::get_if<BaodingFacts>(&episode.track);
  if (facts == nullptr) return {};
  const auto steps = static_cast<double>(std::max<int64_t>(episode.steps, 1));
  return {{"mean distance", absl::StrFormat("%.3f m", facts->distance_sum / steps)},
          {"solved", absl::StrFormat("%d steps", facts->solved_steps)},
          {"mean effort", absl::StrFormat("%.4f", facts->effort_sum / steps)}};
}

std::unique_ptr<Telemetry> WatchBaoding(const Environment& environment) {
  return std::make_unique<baoding::BallTelemetry>(
      static_cast<const BaodingEnvironment&>(environment));
}

}  // namespace myograde::sim
