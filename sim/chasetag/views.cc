// What pictures and replays show of an episode.
#include <absl/strings/str_format.h>

#include <algorithm>

#include "sim/chasetag/chasetag.h"
#include "sim/chasetag/environment.h"
#include "sim/model/official_steps.h"

namespace myograde::sim {
namespace chasetag {
namespace {

constexpr Series kSeries[] = {
    {"distance", "Distance of the person from the opponent", "m"},
    {"speed", "Speed of the person", "m/s"},
    {"effort", "Muscle effort (norm of the activations / 80)", ""},
};

class ChaseTelemetry final : public Telemetry {
 public:
  explicit ChaseTelemetry(const ChaseTagEnvironment& environment) : environment_(environment) {}

  std::span<const Series> series() const override { return kSeries; }

  void Sample(std::span<double> out) const override {
    const auto& environment = static_cast<const Environment&>(environment_);
    const mjData& data = environment.data();
    const double values[] = {environment_.official().distance,
                             Eigen::Vector2d::Map(data.qvel).norm(),
                             MuscleEffort(environment.model(), data)};
    std::copy(std::begin(values), std::end(values), out.begin());
  }

  std::string_view Legend() const override {
    return environment_.chases()
               ? "The pole with a ball is the opponent, which the person has to tag."
               : "The pole with a ball is the opponent, from which the person has to escape.";
  }

  void AfterStep(double time_s, std::vector<TrajectoryEvent>& events) override {
    target_.Add(
        environment_.official().touched, time_s,
        environment_.chases() ? "The person tags the opponent" : "The opponent catches the person",
        "They are apart", events);
  }

 private:
  const ChaseTagEnvironment& environment_;
  TargetEvents target_;
};

}  // namespace
}  // namespace chasetag

const CameraView& ChaseTagView() {
  static const CameraView view = {.body = "root",
                                  .look_at = {0, 0, -0.1},
                                  .distance_m = 7,
                                  .azimuth_deg = 90,
                                  .elevation_deg = -25};
  return view;
}

std::vector<Reading> ChaseTagReadings(const EpisodeFacts& episode) {
  const auto* facts = std::get_if<ChaseTagFacts>(&episode.track);
  if (facts == nullptr) return {};
  const auto steps = static_cast<double>(std::max<int64_t>(episode.steps, 1));
  return {{"task", facts->evades ? "evade" : "chase"},
          {"off the opponent", absl::StrFormat("%.2f m", facts->final_distance)},
          {"nearest", absl::StrFormat("%.2f m", facts->smallest_distance)},
          {"mean effort", absl::StrFormat("%.4f", facts->effort_sum / steps)}};
}

std::unique_ptr<Telemetry> WatchChaseTag(const Environment& environment) {
  return std::make_unique<chasetag::ChaseTelemetry>(
      static_cast<const ChaseTagEnvironment&>(environment));
}

}  // namespace myograde::sim
