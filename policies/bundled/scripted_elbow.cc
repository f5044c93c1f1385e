// Brings the elbow to its target with as little activation as does it.
//
// A virtual spring and damper pull the elbow towards the target; a slow integral takes the error
// away that they leave. The torque that is asked for, less what gravity and the muscles at rest
// give anyway, is spread over the muscles that pull that way so that the norm of the activations
// is smallest: each in proportion to its own torque. Both torques are tables over the angle, taken
// once with mj_forward at zero velocity. Stiffness, damping and integral were chosen among six
// sets by mean time and effort over a hundred episodes.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "policies/cpp/kit.h"

namespace {

constexpr size_t kMuscles = 6;
constexpr size_t kAngle = 0;  // observation: angle of the elbow, rad
constexpr size_t kError = 2;  // observation: target minus angle, rad

constexpr double kStiffness = 15.0;    // N m/rad
constexpr double kDampingTime = 0.1;   // s: damping by stiffness
constexpr double kIntegral = 10.0;     // N m/(rad s)
constexpr double kNear = 0.15;         // rad: farther away nothing is summed up

constexpr double kTableStep = 0.25;  // rad between the rows, from 0
constexpr size_t kRows = 10;

// N m of each muscle when fully active, in the order of the action.
constexpr std::array<std::array<double, kMuscles>, kRows> kPull = {{
    {{-15.48, -3.90, -2.67, 4.70, 3.83, 14.63}},
    {{-18.20, -6.48, -4.73, 9.27, 7.35, 13.64}},
    {{-18.20, -8.80, -6.88, 14.15, 10.81, 12.79}},
    {{-17.07, -10.26, -8.71, 19.14, 14.01, 12.12}},
    {{-15.34, -10.82, -9.65, 23.72, 16.38, 15.28}},
    {{-13.33, -10.63, -9.79, 27.07, 16.86, 17.75}},
    {{-12.92, -11.42, -10.78, 26.76, 14.54, 18.26}},
    {{-12.20, -11.86, -11.44, 20.80, 9.14, 16.34}},
    {{-11.24, -11.95, -11.75, 10.35, 3.97, 12.07}},
    {{-10.11, -11.75, -11.73, 3.23, 1.05, 7.14}},
}};

// N m of gravity and of the muscles at rest.
constexpr std::array<double, kRows> kRest = {1.64,  1.48,  0.26,  -1.72, -3.72,
                                             -4.96, -6.03, -7.05, -7.99, -8.82};

// Between the rows of the tables at an angle: (1 - part) of `row` and `part` of the next.
struct Place {
  explicit Place(double angle) {
    const double rows = std::clamp(angle / kTableStep, 0.0, kRows - 1.001);
    row = static_cast<size_t>(rows);
    part = rows - static_cast<double>(row);
  }
  double Between(double here, double next) const { return here + part * (next - here); }

  size_t row;
  double part;
};

class HoldElbow : public myograde::Policy {
 public:
  explicit HoldElbow(double stiffness) : stiffness_(stiffness) {}

  std::string Name() const override { return "scripted-elbow"; }
  bool Direct() const override { return true; }

  void Start(const myograde::welcome_t& welcome) override { period_ = welcome.control_period_s; }

  void Reset(const myograde::EpisodeInfo&) override {
    first_ = true;
    summed_ = 0;
  }

  void Act(std::span<const double> observation, std::span<double> action) override {
    const double angle = observation[kAngle];
    const double error = observation[kError];
    const double speed = first_ ? 0.0 : (angle - last_angle_) / period_;
    first_ = false;
    last_angle_ = angle;
    if (std::abs(error) < kNear) summed_ += error * period_;

    const Place place(angle);
    const double rest = place.Between(kRest[place.row], kRest[place.row + 1]);
    const double torque = stiffness_ * (error - kDampingTime * speed) + kIntegral * summed_ - rest;
    std::array<double, kMuscles> pull{};
    double square = 0;
    for (size_t i = 0; i < kMuscles; ++i) {
      const double full = place.Between(kPull[place.row][i], kPull[place.row + 1][i]);
      if (full * torque > 0) pull[i] = full;
      square += pull[i] * pull[i];
    }
    for (size_t i = 0; i < kMuscles; ++i) {
      action[i] = square > 0 ? std::clamp(torque * pull[i] / square, 0.0, 1.0) : 0.0;
    }
  }

 private:
  const double stiffness_;  // N m/rad
  double period_ = 0.02;    // s
  bool first_ = true;
  double last_angle_ = 0;  // rad
  double summed_ = 0;      // rad s
};

}  // namespace

// usage: scripted-elbow [--stiffness N]    (a softer spring is slower and takes less effort)
int main(int argc, char** argv) {
  const bool asked = argc == 3 && std::string_view(argv[1]) == "--stiffness";
  const double stiffness = asked ? std::atof(argv[2]) : kStiffness;
  if ((argc != 1 && !asked) || !(stiffness > 0)) {
    std::fprintf(stderr, "usage: scripted-elbow [--stiffness N], in N m/rad\n");
    return 2;
  }
  HoldElbow policy(stiffness);
  return myograde::RunPolicy(policy);
}
