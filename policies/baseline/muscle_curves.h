// MuJoCo's muscles: forces by length and velocity, and the delay of their activation.
#pragma once

#include <algorithm>

namespace myograde::baseline {

inline constexpr double kActivationTime = 0.01;  // s, the models' time constants
inline constexpr double kDeactivationTime = 0.04;

struct MuscleParameters {
  double force;                  // N
  double range_low, range_high;  // of normalised lengths
  double shortest, longest;      // m
  double lmin, lmax, vmax, fpmax, fvmax;
};

inline double Squared(double x) { return x * x; }

// The force-length curve of MuJoCo's muscles: four pieces of parabolas with its peak at 1.
inline double ForceLength(const MuscleParameters& p, double length) {
  if (length <= p.lmin || length >= p.lmax) return 0;
  const double below = (p.lmin + 1) / 2, above = (1 + p.lmax) / 2;
  if (length <= below) return 0.5 * Squared((length - p.lmin) / (below - p.lmin));
  if (length <= 1) return 1 - 0.5 * Squared((1 - length) / (1 - below));
  if (length <= above) return 1 - 0.5 * Squared((length - 1) / (above - 1));
  return 0.5 * Squared((p.lmax - length) / (p.lmax - above));
}

// The force-velocity curve; shortening is negative.
inline double ForceVelocity(const MuscleParameters& p, double velocity) {
  const double top = p.fvmax - 1;
  if (velocity <= -1) return 0;
  if (velocity <= 0) return Squared(velocity + 1);
  if (velocity <= top) return p.fvmax - Squared(top - velocity) / top;
  return p.fvmax;
}

// The pull of the stretched muscle without activation, in units of its force.
inline double PassiveForce(const MuscleParameters& p, double length) {
  const double above = (1 + p.lmax) / 2;
  if (length <= 1) return 0;
  const double x = (length - 1) / (above - 1);
  return length <= above ? p.fpmax * 0.5 * Squared(x)
                         : p.fpmax * (0.5 + (length - above) / (above - 1));
}

struct MusclePull {
  double active;   // N at full activation
  double passive;  // N
};

inline MusclePull PullOf(const MuscleParameters& p, double length, double velocity) {
  const double optimal = (p.longest - p.shortest) / (p.range_high - p.range_low);  // m
  const double normalised = p.range_low + (length - p.shortest) / optimal;
  return {p.force * ForceLength(p, normalised) * ForceVelocity(p, velocity / (optimal * p.vmax)),
          p.force * PassiveForce(p, normalised)};
}

// Seconds in which the activation closes most of its distance to the excitation.
inline double Delay(double activation, bool rising) {
  const double scale = 0.5 + 1.5 * activation;
  return rising ? kActivationTime * scale : kDeactivationTime / scale;
}

// The excitation that takes `from` to `to` in a control step, if any does.
inline double Excitation(double from, double to, double control_step) {
  return std::clamp(from + (to - from) * Delay(from, to > from) / control_step, 0.0, 1.0);
}

struct ActivationBounds {
  double low, high;
};

// Where an activation can be after a control step.
inline ActivationBounds Reachable(double activation, double control_step) {
  const double up = std::min(1.0, control_step / Delay(activation, true));
  const double down = std::min(1.0, control_step / Delay(activation, false));
  return {activation * (1 - down), activation + (1 - activation) * up};
}

}  // namespace myograde::baseline
