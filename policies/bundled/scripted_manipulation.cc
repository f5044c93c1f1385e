// Draws the hand towards the box with as little force as moves it, and keeps the
// prosthesis at rest: the box stays where it is and the palm comes near it.
//
// A virtual spring and damper pull the palm towards the box. Their force is
// spread over the muscles by the transpose of the matrix that tells how each
// muscle's pull moves the palm: moment arms times the palm's Jacobian, taken
// once at the start posture with mj_forward and mj_jacSite, where the arm stays
// close to. Stiffness and damping were chosen among six pairs by the mean final
// distance over eight episodes; stiffer springs knock the box off its pillar.
#include <algorithm>
#include <array>

#include "policies/cpp/kit.h"

namespace {

constexpr size_t kMuscles = 63;
constexpr size_t kHandToObject = 216;  // observation: palm minus object, 3 entries, m
constexpr double kStiffness = 10.0;    // N/m
constexpr double kDamping = 1.0;       // N s/m

// Newton at the palm along x, y, z (world frame) for a newton of a muscle's
// tension, with the sign of a pull (muscles in the order of the action).
constexpr std::array<std::array<double, 3>, kMuscles> kPull = {{
    {{-0.0786, 0.0667, -0.0108}},
    {{0.0118, -0.0008, -0.0169}},
    {{0.0391, -0.0374, 0.0147}},
    {{0.0082, 0.0068, -0.0268}},
    {{0.0109, 0.0005, -0.0182}},
    {{-0.0119, 0.0058, 0.0071}},
    {{0.0061, -0.0050, 0.0006}},
    {{-0.0063, -0.0172, 0.0450}},
    {{-0.0754, 0.0512, 0.0156}},
    {{-0.1525, 0.0830, 0.0948}},
    {{-0.1717, 0.0957, 0.1134}},
    {{0.0397, -0.0963, 0.0864}},
    {{0.0236, -0.0837, 0.1033}},
    {{0.0079, -0.0673, 0.1012}},
    {{-0.0444, 0.0210, 0.0272}},
    {{0.0353, -0.0240, 0.0024}},
    {{0.0068, -0.0020, 0.0024}},
    {{0.0068, -0.0020, 0.0024}},
    {{0.0038, -0.0011, 0.0013}},
    {{-0.0002, 0.0002, -0.0004}},
    {{-0.0250, 0.0209, -0.0138}},
    {{-0.0463, 0.0191, 0.0244}},
    {{-0.0041, 0.0012, -0.0014}},
    {{-0.0143, 0.0042, -0.0048}},
    {{-0.0056, 0.0019, -0.0031}},
    {{-0.0012, 0.0010, -0.0018}},
    {{0.0038, -0.0004, 0.0012}},
    {{-0.0046, 0.0001, -0.0001}},
    {{-0.0027, -0.0002, 0.0006}},
    {{-0.0053, -0.0001, 0.0002}},
    {{-0.0027, 0.0006, -0.0004}},
    {{0.0002, -0.0001, 0.0004}},
    {{-0.0043, 0.0002, -0.0003}},
    {{-0.0039, 0.0001, -0.0001}},
    {{-0.0014, -0.0007, 0.0007}},
    {{-0.0015, -0.0007, 0.0005}},
    {{-0.0008, -0.0006, 0.0007}},
    {{-0.0010, -0.0006, 0.0006}},
    {{-0.0011, -0.0006, 0.0005}},
    {{-0.0014, -0.0005, 0.0004}},
    {{0.0022, 0.0001, 0.0001}},
    {{0.0027, 0.0003, -0.0003}},
    {{0.0020, 0.0004, -0.0007}},
    {{0.0015, 0.0005, -0.0009}},
    {{0.0027, -0.0001, 0.0004}},
    {{0.0005, 0.0006, -0.0008}},
    {{-0.0008, 0.0008, -0.0017}},
    {{-0.0021, 0.0003, -0.0014}},
    {{-0.0019, -0.0004, -0.0002}},
    {{-0.0017, 0.0001, -0.0008}},
    {{0, 0, 0}},
    {{0, 0, 0}},
    {{0, 0, 0}},
    {{0, 0, 0}},
    {{0, 0, 0}},
    {{0, 0, 0}},
    {{0, 0, 0}},
    {{0, 0, 0}},
    {{0, 0, 0}},
    {{0, 0, 0}},
    {{0, 0, 0}},
    {{0, 0, 0}},
    {{0, 0, 0}},
}};

class Reach : public myograde::Policy {
 public:
  std::string Name() const override { return "scripted-manipulation"; }
  bool Direct() const override { return true; }

  void Start(const myograde::welcome_t& welcome) override { welcome_ = welcome; }
  void Reset(const myograde::EpisodeInfo&) override { first_ = true; }

  void Act(std::span<const double> observation, std::span<double> action) override {
    std::array<double, 3> force;
    for (size_t axis = 0; axis < 3; ++axis) {
      const double distance = observation[kHandToObject + axis];
      const double speed =
          first_ ? 0.0 : (distance - last_distance_[axis]) / welcome_.control_period_s;
      force[axis] = -kStiffness * distance - kDamping * speed;
      last_distance_[axis] = distance;
    }
    first_ = false;
    for (size_t i = 0; i < kMuscles; ++i) {
      const double pull =
          kPull[i][0] * force[0] + kPull[i][1] * force[1] + kPull[i][2] * force[2];
      action[i] = std::clamp(-pull, 0.0, 1.0);
    }
    for (size_t i = kMuscles; i < action.size(); ++i) {
      action[i] = std::clamp(0.0, welcome_.action_low[i], welcome_.action_high[i]);
    }
  }

 private:
  myograde::welcome_t welcome_;
  std::array<double, 3> last_distance_{};
  bool first_ = true;
};

}  // namespace

int main() {
  Reach policy;
  return myograde::RunPolicy(policy);
}
