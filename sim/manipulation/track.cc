#include "sim/manipulation/track.h"

#include <absl/strings/str_format.h>

#include "protocol/tracks/manipulation/track.h"
#include "sim/manipulation/environment.h"

namespace myograde::sim {
namespace manipulation {
namespace {

constexpr Series kSeries[] = {
    {"object_height", "Height of the object", "m"},
    {"goal_distance", "Distance of the object from the goal", "m"},
    {"hand_distance", "Distance of the hand from the object", "m"},
    {"prosthesis_distance", "Distance of the prosthesis from the object", "m"},
    {"contact_force", "Contact force on the object", "N"},
    {"effort", "Muscle effort (norm of the activations / 63)", ""},
};

class HandoverTelemetry final : public TelemetryOf<ManipulationEnvironment, kSeries> {
 public:
  using TelemetryOf::TelemetryOf;

  void AfterStep(double time_s, std::vector<TrajectoryEvent>& events) override {
    NoticeForce(time_s);
    const TouchFrame& touch = environment_.touch();
    if (touch[kTouchArm]) {
      if (!arm_touched_) events.push_back({time_s, "first_contact", "The hand touches the object"});
      arm_touched_ = true;
      last_arm_ = time_s;
      released_ = false;
    }
    if (touch[kTouchProsthesis] && arm_touched_) {
      if (!handed_over_)
        events.push_back({time_s, "handover", "The prosthesis touches the object"});
      handed_over_ = true;
      released_ = released_ || !touch[kTouchArm];
    }
    if (touch[kTouchGoal] && !goal_touched_) {
      events.push_back({time_s, "goal_contact", "The object touches the goal pillar"});
      goal_touched_ = true;
    }
  }

  void AtEnd(double, std::vector<TrajectoryEvent>& events) override {
    if (released_) events.push_back({last_arm_, "release", "The hand lets go of the object"});
    if (peak_ <= 0) return;
    events.push_back({peak_time_, "peak_force", "Largest contact force on the object", peak_, "N"});
  }

  std::array<double, 3> ScaleOf(int body) const override {
    if (body != environment_.scene().object_body) return {1, 1, 1};
    const Eigen::Vector3d scale =
        environment_.variation().half_size.cwiseQuotient(environment_.rules().half_size_m);
    return {scale.x(), scale.y(), scale.z()};
  }

 private:
  std::array<double, std::size(kSeries)> Values() const override {
    const mjModel& model = this->model();
    const mjData& data = this->data();
    const Scene& scene = environment_.scene();
    const OfficialView view = ComputeOfficialView(data, scene);
    const OfficialReward reward =
        ComputeOfficialReward(model, data, scene, view, environment_.reference());
    return {ObjectPoint(data, scene, model.geom_pos + 3 * scene.object_box).z(),
            reward.goal_dist,
            view.reach_error.norm(),
            view.pass_error.norm(),
            ObjectForce(model, data, scene),
            reward.act};
  }

  // The facts have the peak over all physics steps.
  void NoticeForce(double time_s) {
    const double peak = std::get<ManipulationFacts>(environment_.facts().track).peak_force;
    if (peak <= peak_) return;
    peak_ = peak;
    peak_time_ = time_s;
  }

  bool arm_touched_ = false;
  bool handed_over_ = false;
  bool released_ = false;  // the prosthesis has had the object since the arm's last touch
  bool goal_touched_ = false;
  double last_arm_ = 0;   // s
  double peak_ = 0;       // N
  double peak_time_ = 0;  // s
};

std::vector<Reading> Readings(const ManipulationFacts& facts, double) {
  return {{"to the goal", absl::StrFormat("%.3f m", facts.final_goal_distance)},
          {"highest lift", absl::StrFormat("%.3f m", facts.max_height)},
          {"peak force", absl::StrFormat("%.1f N", facts.peak_force)}};
}

}  // namespace
}  // namespace manipulation

SimulatedTrack SimulatedManipulation() {
  return {.kind = &ManipulationTrack(),
          .model = &ManipulationModel(),
          // From the front, over both pillars.
          .view = {.look_at = {0, -0.2, 1.15},
                   .distance_m = 1.7,
                   .azimuth_deg = 90,
                   .elevation_deg = -25},
          .make = MakeManipulation,
          .reward_terms = ManipulationEnvironment::kRewardTerms,
          .readings = ReadingsOf<ManipulationFacts, manipulation::Readings>,
          .telemetry = WatchBy<manipulation::HandoverTelemetry>};
}

}  // namespace myograde::sim
