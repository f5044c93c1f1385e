#include "sim/locomotion/telemetry.h"

#include <algorithm>

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

class WalkTelemetry final : public Telemetry {
 public:
  explicit WalkTelemetry(const LocomotionEnvironment& environment) : environment_(environment) {}

  std::span<const Series> series() const override { return kSeries; }

  void Sample(std::span<double> out) const override {
    const mjData& data = environment_.data();
    const LocomotionTerms terms = environment_.terms();
    const mjtNum* pelvis = data.xpos + 3 * environment_.indices().pelvis_body;
    const double values[] = {std::get<LocomotionFacts>(environment_.facts().track).distance,
                             -data.qvel[1],
                             pelvis[2] - environment_.terrain().GroundAt(pelvis[0], pelvis[1]),
                             static_cast<double>(environment_.leg_state()),
                             environment_.SenseLeg().load,
                             terms.pain * kPainScale,
                             terms.effort};
    std::copy(std::begin(values), std::end(values), out.begin());
  }

  void Begin() override { state_ = environment_.leg_state(); }

  void AfterStep(double time_s, std::vector<TrajectoryEvent>& events) override {
    const LegState now = environment_.leg_state();
    if (now == state_) return;
    state_ = now;
    events.push_back({time_s, "leg_state",
                      std::string(kLegStateTitles[static_cast<size_t>(now)])});
  }

  void AtEnd(double time_s, std::vector<TrajectoryEvent>& events) override {
    const EpisodeFacts facts = environment_.facts();
    if (facts.end != LocomotionEnd::kFell) return;
    events.push_back({time_s, "fall", "The walker has fallen",
                      std::get<LocomotionFacts>(facts.track).distance, "m"});
  }

 private:
  const LocomotionEnvironment& environment_;
  LegState state_ = LegState::kEarlyStance;
};

}  // namespace
}  // namespace locomotion

std::unique_ptr<Telemetry> WatchLocomotion(const Environment& environment) {
  return std::make_unique<locomotion::WalkTelemetry>(static_cast<const LocomotionEnvironment&>(environment));
}

}  // namespace myograde::sim
