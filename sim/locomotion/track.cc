#include "sim/locomotion/track.h"

#include <absl/strings/str_format.h>

#include <string>

#include "protocol/tracks/locomotion/track.h"
#include "sim/locomotion/environment.h"

namespace myograde::sim {
namespace locomotion {
namespace {

constexpr std::string_view kLegStateTitles[] = {"early stance", "late stance", "early swing",
                                                "late swing"};
constexpr Series kSeries[] = {
    {"distance", "Distance", "m"},
    {"speed", "Speed", "m/s"},
    {"pelvis_height", "Height of the pelvis above the ground", "m"},
    {"leg_state", "State of the prosthetic leg", "", kLegStateTitles},
    {"leg_load", "Load on the prosthetic leg", "N"},
    {"limit_torque", "Mean torque of the joints' limits", "N m"},
    {"effort", "Mean squared muscle activation", ""},
};
constexpr double kPainScale = 1000;  // the official term is in thousands of N m

class WalkTelemetry final : public TelemetryOf<LocomotionEnvironment, kSeries> {
 public:
  using TelemetryOf::TelemetryOf;

  void Begin() override { state_ = environment_.leg_state(); }

  void AfterStep(double time_s, std::vector<TrajectoryEvent>& events) override {
    const LegState now = environment_.leg_state();
    if (now == state_) return;
    state_ = now;
    events.push_back({time_s, "leg_state", std::string(kLegStateTitles[static_cast<size_t>(now)])});
  }

  void AtEnd(double time_s, std::vector<TrajectoryEvent>& events) override {
    const EpisodeFacts facts = environment_.facts();
    if (facts.end != LocomotionEnd::kFell) return;
    events.push_back({time_s, "fall", "The walker has fallen",
                      std::get<LocomotionFacts>(facts.track).distance, "m"});
  }

 private:
  std::array<double, std::size(kSeries)> Values() const override {
    const mjData& data = this->data();
    const LocomotionTerms terms = environment_.terms();
    const mjtNum* pelvis = data.xpos + 3 * environment_.indices().pelvis_body;
    return {std::get<LocomotionFacts>(environment_.facts().track).distance,
            -data.qvel[1],
            pelvis[2] - environment_.terrain().GroundAt(pelvis[0], pelvis[1]),
            static_cast<double>(environment_.leg_state()),
            environment_.SenseLeg().load,
            terms.pain * kPainScale,
            terms.effort};
  }

  LegState state_ = LegState::kEarlyStance;
};

std::vector<Reading> Readings(const LocomotionFacts& facts, double steps) {
  constexpr std::array<const char*, 5> kCourses = {"flat", "hilly", "rough", "stairs", "mixed"};
  const auto course = static_cast<size_t>(facts.course);
  return {{"course", course < kCourses.size() ? kCourses[course] : "-"},
          {"distance", absl::StrFormat("%.1f m", facts.distance)},
          {"mean pain", absl::StrFormat("%.4f", facts.pain_sum / steps)}};
}

}  // namespace
}  // namespace locomotion

SimulatedTrack SimulatedLocomotion() {
  return {.kind = &LocomotionTrack(),
          .model = &LocomotionModel(),
          // Beside the walker and a little ahead, on the prosthesis' side.
          .view = {.body = "root",
                   .look_at = {0, 0, -0.05},
                   .distance_m = 2.8,
                   .azimuth_deg = 30,
                   .elevation_deg = -15},
          .make = MakeOf<LocomotionEnvironment, ParseLocomotionRules, LocomotionModel>,
          .reward_terms = LocomotionEnvironment::kRewardTerms,
          .readings = ReadingsOf<LocomotionFacts, locomotion::Readings>,
          .telemetry = WatchBy<locomotion::WalkTelemetry>};
}

}  // namespace myograde::sim
