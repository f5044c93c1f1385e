#include "sim/baoding/track.h"

#include <absl/strings/str_format.h>

#include "protocol/tracks/baoding/track.h"
#include "sim/baoding/environment.h"

namespace myograde::sim {
namespace baoding {
namespace {

constexpr Series kSeries[] = {
    {"distance_1", "Distance of the yellow ball from its target", "m"},
    {"distance_2", "Distance of the pink ball from its target", "m", {}, "distance_1"},
    {"effort", "Muscle effort (norm of the activations / 39)", ""},
};

class BallTelemetry final : public TelemetryOf<BaodingEnvironment, kSeries> {
 public:
  using TelemetryOf::TelemetryOf;

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
  std::array<double, std::size(kSeries)> Values() const override {
    const BaodingEnvironment::Official now = environment_.official();
    return {now.distances[0], now.distances[1], Effort()};
  }

  TargetEvents target_;
};

std::vector<Reading> Readings(const BaodingFacts& facts, double steps) {
  return {{"mean distance", absl::StrFormat("%.3f m", facts.distance_sum / steps)},
          {"solved", absl::StrFormat("%d steps", facts.solved_steps)}};
}

}  // namespace
}  // namespace baoding

SimulatedTrack SimulatedBaoding() {
  return {.kind = &BaodingTrack(),
          .model = &BaodingModel(),
          // From the front and above, at the palm with the balls.
          .view = {.look_at = {-0.24, -0.53, 1.45},
                   .distance_m = 0.5,
                   .azimuth_deg = 90,
                   .elevation_deg = -45},
          .make = MakeOf<BaodingEnvironment, ParseBaodingRules, BaodingModel>,
          .reward_terms = BaodingEnvironment::kRewardTerms,
          .readings = ReadingsOf<BaodingFacts, baoding::Readings>,
          .telemetry = WatchBy<baoding::BallTelemetry>};
}

}  // namespace myograde::sim
