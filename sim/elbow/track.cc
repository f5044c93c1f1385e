#include "sim/elbow/track.h"

#include <absl/strings/str_format.h>

#include <numbers>

#include "protocol/tracks/elbow/track.h"
#include "sim/elbow/environment.h"
#include "sim/elbow/pins.h"

namespace myograde::sim {
namespace elbow {
namespace {

constexpr Series kSeries[] = {
    {"angle", "Angle of the elbow", "deg"},
    {"target", "Target", "deg", {}, "angle"},
    {"error", "Distance from the target", "deg"},
    {"effort", "Muscle effort (norm of the activations / 6)", ""},
};

double Degrees(double radians) { return radians * 180 / std::numbers::pi; }

class ElbowTelemetry final : public TelemetryOf<ElbowEnvironment, kSeries> {
 public:
  using TelemetryOf::TelemetryOf;

  std::vector<TargetPose> Targets() const override {
    const mjModel& model = this->model();
    const DataPtr there(mj_copyData(nullptr, &model, &data()));
    there->qpos[0] = environment_.target();
    mj_kinematics(&model, there.get());
    TargetPose pose = {.body = model.jnt_bodyid[0]};
    mju_copy3(pose.position.data(), there->xpos + 3 * pose.body);
    mju_copy4(pose.rotation.data(), there->xquat + 4 * pose.body);
    return {pose};
  }

  double ToleranceOf(std::string_view series) const override {
    return series == "target" ? Degrees(environment_.rules().tolerance_rad) : 0;
  }

  void AfterStep(double time_s, std::vector<TrajectoryEvent>& events) override {
    const bool within = -environment_.official().pose <= environment_.rules().tolerance_rad;
    target_.Add(within, time_s, "The elbow is at the target", "The elbow has left the target",
                events);
  }

 private:
  std::array<double, std::size(kSeries)> Values() const override {
    const ElbowEnvironment::Official now = environment_.official();
    const double target = environment_.target();
    return {Degrees(data().qpos[0]), Degrees(target), Degrees(-now.pose), -now.act_reg};
  }

  TargetEvents target_;
};

std::vector<Reading> Readings(const ElbowFacts& facts, double) {
  return {{"target", absl::StrFormat("%.3f rad", facts.target_angle)},
          {"error", absl::StrFormat("%.3f rad", facts.final_error)}};
}

}  // namespace
}  // namespace elbow

// Nothing in its files needs a patch, and no body that moves gets its mass from a mesh (README.md
// has the comparison). In play the arm touches nothing, the only constraint is the joint's stop,
// and the stack holds 60 numbers: the buffers are many times of that, and still small.
const ModelSource& ElbowModel() {
  static const ModelSource source = {
      .name = "elbow",
      .pins = elbow::kPins,
      .main_file = "envs/myo/assets/elbow/myoelbow_1dof6muscles.xml",
      .actuator_file = "simhive/myo_sim/elbow/assets/myoelbow_1dof6muscles_body.xml",
      .inertials = {},
      .buffers = {200, 50, 200'000},
      .patch = nullptr};
  return source;
}

SimulatedTrack SimulatedElbow() {
  return {.kind = &ElbowTrack(),
          .model = &ElbowModel(),
          // From the side, where the forearm moves in the plane of the picture and muscles are
          // before the bones.
          .view = {.look_at = {-0.15, -0.05, 1.15},
                   .distance_m = 1.05,
                   .azimuth_deg = 0,
                   .elevation_deg = -10},
          .make = MakeOf<ElbowEnvironment, ParseElbowRules, ElbowModel>,
          .reward_terms = ElbowEnvironment::kRewardTerms,
          .readings = ReadingsOf<ElbowFacts, elbow::Readings>,
          .telemetry = WatchBy<elbow::ElbowTelemetry>};
}

}  // namespace myograde::sim
