#include "sim/elbow/telemetry.h"

#include <algorithm>
#include <numbers>
#include <vector>

#include "sim/elbow/environment.h"
#include "sim/model/model.h"

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

class ElbowTelemetry final : public Telemetry {
 public:
  explicit ElbowTelemetry(const ElbowEnvironment& environment) : environment_(environment) {}

  std::span<const Series> series() const override { return kSeries; }

  void Sample(std::span<double> out) const override {
    const ElbowEnvironment::Official now = environment_.official();
    const double target = environment_.target();
    const mjData& data = static_cast<const Environment&>(environment_).data();
    const double values[] = {Degrees(data.qpos[0]), Degrees(target), Degrees(-now.pose),
                             -now.act_reg};
    std::copy(std::begin(values), std::end(values), out.begin());
  }

  std::vector<TargetPose> Targets() const override {
    const auto& environment = static_cast<const Environment&>(environment_);
    const mjModel& model = environment.model();
    const DataPtr there(mj_copyData(nullptr, &model, &environment.data()));
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
  const ElbowEnvironment& environment_;
  TargetEvents target_;
};

}  // namespace
}  // namespace elbow

std::unique_ptr<Telemetry> WatchElbow(const Environment& environment) {
  return std::make_unique<elbow::ElbowTelemetry>(
      static_cast<const ElbowEnvironment&>(environment));
}

}  // namespace myograde::sim
