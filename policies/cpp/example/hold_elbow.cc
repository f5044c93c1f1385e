// Holds the elbow at its target with a spring, a damper and an integral. Where its numbers lie in
// the vectors it learns from the names in the welcome.
#include <myograde/kit.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <stdexcept>

namespace {

constexpr size_t kExtensors = 3;  // the first muscles of the action; as many flexors follow

// Excitation of all flexors (or, below 0, of all extensors) for what the elbow still has to turn.
constexpr double kStiffness = 0.8;    // 1/rad
constexpr double kDampingTime = 0.1;  // s: damping by stiffness
constexpr double kIntegral = 4.0;     // 1/(rad s)
constexpr double kNear = 0.3;         // rad: farther away nothing is summed up

class HoldElbow : public myograde::Policy {
 public:
  std::string Name() const override { return "hold-elbow"; }
  bool Direct() const override { return true; }  // actions are excitations, 0 to 1

  void Start(const myograde::welcome_t& welcome) override {
    welcome_ = welcome;
    const std::vector<double> sample(static_cast<size_t>(welcome.observation_size));
    if (PartOf(std::span(sample), welcome.observation_parts, "pose_err").size() != 1) {
      throw std::runtime_error("this policy is for tracks of an elbow, and not for " +
                               welcome.track);
    }
  }

  void Reset(const myograde::EpisodeInfo&) override {
    first_ = true;
    summed_ = 0;
  }

  void Act(std::span<const double> observation, std::span<double> action) override {
    const double angle = PartOf(observation, welcome_.observation_parts, "qpos")[0];
    const double error = PartOf(observation, welcome_.observation_parts, "pose_err")[0];
    const double period = welcome_.control_period_s;
    const double speed = first_ ? 0.0 : (angle - last_angle_) / period;
    first_ = false;
    last_angle_ = angle;
    if (std::abs(error) < kNear) summed_ += error * period;

    const double pull = kStiffness * (error - kDampingTime * speed) + kIntegral * summed_;
    const std::span<double> muscles = PartOf(action, welcome_.action_parts, "muscles");
    for (size_t i = 0; i < muscles.size(); ++i) {
      muscles[i] = std::clamp(i < kExtensors ? -pull : pull, 0.0, 1.0);
    }
  }

 private:
  myograde::welcome_t welcome_;
  bool first_ = true;
  double last_angle_ = 0;  // rad
  double summed_ = 0;      // rad s
};

}  // namespace

int main() {
  HoldElbow policy;
  try {
    return myograde::RunPolicy(policy);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
  }
}
