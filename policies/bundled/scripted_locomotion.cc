// Stands and falls late: a fixed tone of every muscle, and reflexes that answer
// the lean of the trunk and the speed of that lean, forwards and sideways.
//
// The numbers come from an evolution strategy (diagonal covariance, 20
// candidates a generation) that maximised the mean time before a fall over
// seeded starts on level ground. What it does not do is walk.
#include <algorithm>
#include <array>
#include <cmath>

#include "policies/cpp/kit.h"

namespace {

constexpr size_t kMuscles = 54;
constexpr size_t kPelvisQuaternion = 41;  // observation: w, x, y, z
constexpr double kSpeedWeight = 0.1;      // s: how much a speed of leaning counts as a lean

struct Reflex {
  double tone;      // excitation without any lean
  double forwards;  // per unit of lean, forwards positive
  double sideways;  // per unit of lean, to the right positive
};

// One for each muscle, in the order of the action.
constexpr std::array<Reflex, kMuscles> kReflexes = {{
    {0.14, -0.37, -0.71},
    {0.72, 0.45, 0.07},
    {0.10, -0.21, 0.24},
    {0.56, 0.97, -2.36},
    {0.45, 1.08, 1.28},
    {0.19, 0.20, 0.73},
    {0.03, -1.27, 0.38},
    {0.20, 0.83, 0.81},
    {0.05, -1.27, -0.11},
    {0.27, 0.91, 0.20},
    {0.58, -0.93, -1.52},
    {0.20, -0.71, -2.06},
    {0.45, 0.65, 0.03},
    {0.03, -0.48, -0.09},
    {0.51, -0.59, -0.26},
    {0.79, 1.92, 0.10},
    {-0.02, 0.06, 0.44},
    {0.33, 0.99, -0.58},
    {0.19, 0.82, 0.48},
    {0.29, 0.12, -1.30},
    {0.42, -1.72, 0.05},
    {0.64, -0.99, -0.81},
    {0.76, -1.49, 1.56},
    {0.36, -0.28, 1.25},
    {0.46, 1.93, -1.05},
    {0.03, -0.39, 0.80},
    {0.05, 0.20, -1.19},
    {0.52, 1.26, -1.00},
    {0.98, -0.49, -0.55},
    {-0.09, -1.34, 1.65},
    {0.19, -0.45, 1.57},
    {0.77, -0.51, -1.22},
    {0.60, 0.61, 0.15},
    {0.65, -0.17, -1.13},
    {0.14, -1.79, 1.31},
    {0.24, 0.01, 0.84},
    {0.17, -0.65, 0.73},
    {0.25, -1.63, 0.88},
    {0.01, 0.71, 0.36},
    {-0.14, -0.35, -0.14},
    {0.57, 1.27, 1.72},
    {0.24, 0.02, 0.13},
    {-0.46, 0.53, 0.79},
    {0.23, -0.74, 0.63},
    {0.18, 1.04, 0.13},
    {0.54, 1.65, 0.10},
    {0.83, 2.01, -0.87},
    {0.39, 1.53, -0.78},
    {0.31, 0.07, 0.49},
    {0.69, -0.53, -0.87},
    {0.06, -0.20, 0.81},
    {0.84, -0.66, -1.08},
    {0.54, -2.19, 0.31},
    {0.52, 0.71, -0.67},
}};

// A unit quaternion w + xi + yj + zk.
struct Quaternion {
  double w = 1, x = 0, y = 0, z = 0;

  Quaternion Conjugate() const { return {w, -x, -y, -z}; }
};

Quaternion operator*(const Quaternion& a, const Quaternion& b) {
  return {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
          a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
          a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
          a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
}

class Stand : public myograde::Policy {
 public:
  std::string Name() const override { return "scripted-locomotion"; }
  bool Direct() const override { return true; }

  void Start(const myograde::welcome_t& welcome) override {
    period_s_ = welcome.control_period_s;
  }
  void Reset(const myograde::EpisodeInfo&) override { first_ = true; }

  void Act(std::span<const double> observation, std::span<double> action) override {
    const auto q = observation.subspan(kPelvisQuaternion, 4);
    // The pelvis frame lies a quarter turn about x ahead of the trunk's.
    const double half = std::sqrt(0.5);
    const Quaternion trunk = Quaternion{q[0], q[1], q[2], q[3]} * Quaternion{half, -half, 0, 0};
    // The speed of turning in the trunk's frame, from the last two observations.
    const Quaternion turn = last_.Conjugate() * trunk;
    const double rate = first_ ? 0.0 : std::copysign(2.0, turn.w) / period_s_;  // rad/s
    last_ = trunk;
    first_ = false;
    // The world's vertical in the trunk's frame.
    const double up_x = 2 * (trunk.x * trunk.z - trunk.w * trunk.y);
    const double up_y = 2 * (trunk.y * trunk.z + trunk.w * trunk.x);
    const double forwards = -up_x + kSpeedWeight * rate * turn.y;
    const double sideways = up_y + kSpeedWeight * rate * turn.x;
    for (size_t i = 0; i < kMuscles; ++i) {
      const Reflex& reflex = kReflexes[i];
      action[i] = std::clamp(
          reflex.tone + reflex.forwards * forwards + reflex.sideways * sideways, 0.0, 1.0);
    }
  }

 private:
  double period_s_ = 0;
  Quaternion last_;
  bool first_ = true;
};

}  // namespace

int main() {
  Stand policy;
  return myograde::RunPolicy(policy);
}
