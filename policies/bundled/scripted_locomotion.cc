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
    {0.30, 1.15, -0.42},
    {-0.26, -0.47, -0.84},
    {0.41, -0.03, 1.68},
    {1.13, 0.58, 0.46},
    {0.30, 0.29, -1.66},
    {0.09, -0.17, -0.25},
    {0.17, -0.76, -0.95},
    {-0.52, 1.60, -0.30},
    {0.12, -1.20, 0.06},
    {0.04, -2.05, -1.26},
    {-0.21, -0.89, 1.45},
    {0.38, -2.50, -1.49},
    {-0.24, 2.94, -0.83},
    {0.33, -0.04, -0.82},
    {0.52, -0.09, 0.16},
    {0.65, -0.35, -2.00},
    {-0.52, 0.99, 0.18},
    {-0.11, -0.02, -0.75},
    {0.22, 1.66, -0.43},
    {0.17, -0.60, -1.08},
    {-0.30, 0.05, -1.85},
    {0.40, 1.97, 0.68},
    {0.46, -0.45, 0.85},
    {0.21, -0.65, 1.07},
    {0.15, 1.34, -0.26},
    {0.13, -0.26, -0.94},
    {0.36, 1.55, 0.43},
    {0.01, -0.32, -0.01},
    {0.43, 1.64, -0.45},
    {-0.16, 1.16, -0.19},
    {-0.43, -0.33, -0.57},
    {-0.20, 0.36, 0.46},
    {0.14, 4.51, -1.06},
    {-0.15, 0.15, -0.95},
    {0.16, -0.71, 0.81},
    {0.05, -1.02, -0.27},
    {-0.45, 0.23, -0.98},
    {0.14, 1.70, 0.79},
    {0.64, -2.13, 1.44},
    {0.41, -2.24, 0.85},
    {0.35, -0.09, -1.15},
    {-0.05, 1.35, 0.33},
    {0.18, -0.38, -0.03},
    {-0.36, -1.62, 0.30},
    {-0.02, -0.31, 0.20},
    {0.04, 2.19, 1.51},
    {0.09, -1.37, 0.10},
    {0.70, -1.28, 1.96},
    {0.74, -0.28, 1.82},
    {0.33, 2.47, -1.55},
    {0.18, -0.26, -2.47},
    {0.33, -0.42, 0.56},
    {0.04, -1.58, 0.65},
    {1.12, -0.76, 0.85},
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
