#include "policies/baseline/leg_muscles.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string_view>
#include <vector>

namespace myograde::baseline {
namespace {

constexpr double kActivationTime = 0.01;   // s, the model's time constants
constexpr double kDeactivationTime = 0.04;
constexpr int kSweeps = 12;                // of the coordinate descent

struct Parameters {
  double force;                        // N
  double range_low, range_high;        // of normalised lengths
  double shortest, longest;            // m
  double lmin, lmax, vmax, fpmax, fvmax;
};

struct Entry {
  const char* name;
  std::vector<int> joints;
  Parameters parameters;
  std::vector<double> weights;
};

struct Muscle {
  LengthTerms terms;
  Parameters parameters;
  std::vector<double> weights;
};

const std::vector<Entry>& Entries() {
  static const std::vector<Entry> entries = {
#include "policies/baseline/leg_muscles.inc"
  };
  return entries;
}

const std::vector<Muscle>& Muscles() {
  static const std::vector<Muscle> muscles = [] {
    std::vector<Muscle> out;
    for (const Entry& entry : Entries()) {
      out.push_back({LengthTerms(entry.joints), entry.parameters, entry.weights});
    }
    return out;
  }();
  return muscles;
}

double Squared(double x) { return x * x; }

// The force-length curve of MuJoCo's muscles: four pieces of parabolas with its peak at 1.
double ForceLength(const Parameters& p, double length) {
  if (length <= p.lmin || length >= p.lmax) return 0;
  const double below = (p.lmin + 1) / 2, above = (1 + p.lmax) / 2;
  if (length <= below) return 0.5 * Squared((length - p.lmin) / (below - p.lmin));
  if (length <= 1) return 1 - 0.5 * Squared((1 - length) / (1 - below));
  if (length <= above) return 1 - 0.5 * Squared((length - 1) / (above - 1));
  return 0.5 * Squared((p.lmax - length) / (p.lmax - above));
}

// The force-velocity curve; shortening is negative.
double ForceVelocity(const Parameters& p, double velocity) {
  const double top = p.fvmax - 1;
  if (velocity <= -1) return 0;
  if (velocity <= 0) return Squared(velocity + 1);
  if (velocity <= top) return p.fvmax - Squared(top - velocity) / top;
  return p.fvmax;
}

// The pull of the stretched muscle without activation, in units of its force.
double PassiveForce(const Parameters& p, double length) {
  const double above = (1 + p.lmax) / 2;
  if (length <= 1) return 0;
  const double x = (length - 1) / (above - 1);
  return length <= above ? p.fpmax * 0.5 * Squared(x)
                         : p.fpmax * (0.5 + (length - above) / (above - 1));
}

struct Pull {
  double active;   // N at full activation
  double passive;  // N
};

Pull PullOf(const Parameters& p, double length, double velocity) {
  const double optimal = (p.longest - p.shortest) / (p.range_high - p.range_low);  // m
  const double normalised = p.range_low + (length - p.shortest) / optimal;
  return {p.force * ForceLength(p, normalised) * ForceVelocity(p, velocity / (optimal * p.vmax)),
          p.force * PassiveForce(p, normalised)};
}

// Seconds in which the activation closes most of its distance to the excitation.
double Delay(double activation, bool rising) {
  const double scale = 0.5 + 1.5 * activation;
  return rising ? kActivationTime * scale : kDeactivationTime / scale;
}

// The excitation that takes `from` to `to` in a control step, if any does.
double Excitation(double from, double to) {
  return std::clamp(from + (to - from) * Delay(from, to > from) / kControlStep, 0.0, 1.0);
}

struct Bounds {
  double low, high;
};

// Where an activation can be after a control step.
Bounds Reachable(double activation) {
  const double up = std::min(1.0, kControlStep / Delay(activation, true));
  const double down = std::min(1.0, kControlStep / Delay(activation, false));
  return {activation * (1 - down), activation + (1 - activation) * up};
}

}  // namespace

const std::array<size_t, kMuscles>& SortedPlaces() {
  static const std::array<size_t, kMuscles> places = [] {
    std::array<size_t, kMuscles> order, out;
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::sort(order, {}, [](size_t i) { return std::string_view(Entries()[i].name); });
    for (size_t place = 0; place < kMuscles; ++place) out[order[place]] = place;
    return out;
  }();
  return places;
}

std::array<double, kLengthJoints> MuscleTorques(const MuscleState& state) {
  std::array<double, kLengthJoints> torques{};
  for (int i = 0; i < kMuscles; ++i) {
    const Muscle& muscle = Muscles()[i];
    std::array<double, kMostJoints> arms{};
    muscle.terms.AddSlopes(muscle.weights, state.angles, arms);
    const Pull pull = PullOf(muscle.parameters, state.length[i], state.velocity[i]);
    for (int j = 0; j < muscle.terms.joints(); ++j) {
      torques[muscle.terms.joint(j)] -=
          arms[j] * (pull.active * state.activation[i] + pull.passive);
    }
  }
  return torques;
}

void MuscleAllocator::Allocate(const MuscleState& state, const TorqueGoal& goal,
                               std::span<double, kMuscles> excitations) {
  // Torque of each muscle at full activation, and what is missing of the goal.
  std::array<std::array<double, kMostJoints>, kMuscles> torque{};
  std::array<double, kLengthJoints> missing = goal.torque;
  std::array<Bounds, kMuscles> bounds;
  const std::vector<Muscle>& muscles = Muscles();
  for (int i = 0; i < kMuscles; ++i) {
    const Muscle& muscle = muscles[i];
    std::array<double, kMostJoints> arms{};
    muscle.terms.AddSlopes(muscle.weights, state.angles, arms);
    const Pull pull = PullOf(muscle.parameters, state.length[i], state.velocity[i]);
    bounds[i] = Reachable(state.activation[i]);
    last_[i] = std::clamp(last_[i], bounds[i].low, bounds[i].high);
    for (int j = 0; j < muscle.terms.joints(); ++j) {
      torque[i][j] = -arms[j] * pull.active;
      missing[muscle.terms.joint(j)] += arms[j] * pull.passive - torque[i][j] * last_[i];
    }
  }
  // Coordinate descent on the squared torque that is missing plus the squared effort.
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    for (int i = 0; i < kMuscles; ++i) {
      const LengthTerms& terms = muscles[i].terms;
      double slope = -effort_ * last_[i], curvature = effort_;
      for (int j = 0; j < terms.joints(); ++j) {
        const double weighted = goal.weight[terms.joint(j)] * torque[i][j];
        slope += weighted * missing[terms.joint(j)];
        curvature += weighted * torque[i][j];
      }
      const double next =
          std::clamp(last_[i] + slope / curvature, bounds[i].low, bounds[i].high);
      for (int j = 0; j < terms.joints(); ++j) {
        missing[terms.joint(j)] -= torque[i][j] * (next - last_[i]);
      }
      last_[i] = next;
    }
  }
  for (int i = 0; i < kMuscles; ++i) excitations[i] = Excitation(state.activation[i], last_[i]);
}

}  // namespace myograde::baseline
