#include "sim/chasetag/track.h"

#include <absl/strings/str_format.h>

#include "protocol/tracks/chasetag/track.h"
#include "sim/chasetag/environment.h"

namespace myograde::sim {
namespace chasetag {
namespace {

constexpr Series kSeries[] = {
    {"distance", "Distance of the person from the opponent", "m"},
    {"speed", "Speed of the person", "m/s"},
    {"effort", "Muscle effort (norm of the activations / 80)", ""},
};

class ChaseTelemetry final : public TelemetryOf<ChaseTagEnvironment, kSeries> {
 public:
  using TelemetryOf::TelemetryOf;

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
  std::array<double, std::size(kSeries)> Values() const override {
    return {environment_.official().distance, Eigen::Vector2d::Map(data().qvel).norm(), Effort()};
  }

  TargetEvents target_;
};

std::vector<Reading> Readings(const ChaseTagFacts& facts, double) {
  return {{"task", facts.evades ? "evade" : "chase"},
          {"off the opponent", absl::StrFormat("%.2f m", facts.final_distance)},
          {"nearest", absl::StrFormat("%.2f m", facts.smallest_distance)}};
}

}  // namespace
}  // namespace chasetag

SimulatedTrack SimulatedChaseTag() {
  return {.kind = &ChaseTagTrack(),
          .model = &ChaseTagModel(),
          // Moves along with the person.
          .view = {.body = "root",
                   .look_at = {0, 0, -0.1},
                   .distance_m = 7,
                   .azimuth_deg = 90,
                   .elevation_deg = -25},
          .make = MakeOf<ChaseTagEnvironment, ParseChaseTagRules, ChaseTagModel>,
          .reward_terms = ChaseTagEnvironment::kRewardTerms,
          .readings = ReadingsOf<ChaseTagFacts, chasetag::Readings>,
          .telemetry = WatchBy<chasetag::ChaseTelemetry>};
}

}  // namespace myograde::sim
