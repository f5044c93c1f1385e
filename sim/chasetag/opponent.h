// The opponent of chase-tag: a body without mass or contacts that moves in the plane by the policy
// that was drawn for the episode.
#pragma once

#include <mujoco/mujoco.h>

#include <Eigen/Core>
#include <array>
#include <vector>

#include "sim/chasetag/rules.h"
#include "sim/random/numpy.h"

namespace myograde::sim {

// Two independent series of noise with a spectral density of 1 / f^2 and a variance of 1, as the
// package pink draws them: one spectrum for 2,000 samples. Draws are NumPy's to the bit, samples
// are sums in an order of our own.
class BrownNoise {
 public:
  BrownNoise();

  void Restart(NumpyGenerator& generator);
  // The next sample of both; draws a new spectrum after the last.
  Eigen::Vector2d Sample(NumpyGenerator& generator);

 private:
  static constexpr int kSamples = 2000;
  static constexpr int kFrequencies = kSamples / 2 + 1;
  using Spectrum = Eigen::Array<double, 2, kFrequencies>;

  double deviation_;  // of a sample, without scaling
  std::vector<double> cosine_;
  Spectrum real_, imaginary_;
  int next_ = 0;
};

class Opponent {
 public:
  explicit Opponent(const ChaseTagRules& rules) : rules_(rules) {}

  // Where it is: x and y in m, and the angle that it is turned by, in rad. It moves towards -y when
  // the angle is 0.
  static Eigen::Vector3d PoseOf(const mjData& data);

  // Draws its policy, its place (`root`: the person's) and its speed, and puts it there.
  void Reset(bool chased, const Eigen::Vector2d& root, NumpyGenerator& generator, mjData& data);
  // Moves it for a control step of `period` s. `pelvis`: the person's place.
  void Move(const Eigen::Vector2d& pelvis, double period, NumpyGenerator& generator, mjData& data);

  OpponentPolicy policy() const { return policy_; }
  double chase_speed() const { return chase_speed_; }  // m/s, wanted where it chases
  const BrownNoise& noise() const { return noise_; }
  // Of the last Move: along its direction in m/s, never negative, and its turn in rad/s.
  const Eigen::Vector2d& velocity() const { return velocity_; }

 private:
  OpponentPolicy DrawPolicy(NumpyGenerator& generator) const;
  Eigen::Vector2d Decide(const Eigen::Vector3d& pose, const Eigen::Vector2d& pelvis,
                         NumpyGenerator& generator);
  Eigen::Vector2d Escape(const Eigen::Vector3d& pose, const Eigen::Vector2d& pelvis,
                         NumpyGenerator& generator);

  ChaseTagRules rules_;
  BrownNoise noise_;
  // Of the episode.
  OpponentPolicy policy_ = OpponentPolicy::kStationary;
  double chase_speed_ = 0;  // m/s
  Eigen::Vector2d velocity_ = Eigen::Vector2d::Zero();
};

}  // namespace myograde::sim
