#include "sim/chasetag/opponent.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/model/rotation.h"

namespace myograde::sim {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using std::numbers::pi;

constexpr double kNoiseScale = 10;
constexpr double kFastest = 2;  // m/s and rad/s
constexpr double kLimit = 5.5;  // m: it does not leave this square

void Place(const Vector3d& pose, mjData& data) {
  Vector2d::Map(data.mocap_pos) = pose.head<2>();
  Eigen::Vector4d::Map(data.mocap_quat) = OfficialQuaternion({0, 0, pose.z()});
}

// The angle between 0 and a full turn, by as many turns as it takes.
double Wrapped(double angle) {
  while (angle > 2 * pi) angle -= 2 * pi;
  while (angle < 0) angle += 2 * pi;
  return angle;
}

// As fast as it can, without stopping; in rad/s. It does not take the shorter way round: it turns
// forwards where the wrapped angle is to grow.
double Turn(double from, double to) {
  from = Wrapped(from);
  to = Wrapped(to);
  return std::abs(0 - from) + (2 * pi - to) < (2 * pi - from) + (0 + to) ? 1 : -1;
}

// Points along the walls that repel it, 8.7 m from the middle.
constexpr int kWallPoints = 25;  // of each wall
constexpr double kWall = 8.7;

Vector2d WallPoint(int i) {
  const int along = i % kWallPoints;
  const double step = 2 * kWall / (kWallPoints - 1);
  const double place = along == kWallPoints - 1 ? kWall : along * step - kWall;
  const double side = i / kWallPoints % 2 == 0 ? kWall : -kWall;
  return i < 2 * kWallPoints ? Vector2d(side, place) : Vector2d(place, side);
}

}  // namespace

BrownNoise::BrownNoise() : cosine_(kSamples) {
  for (int i = 0; i < kSamples; ++i) {
    cosine_[static_cast<size_t>(i)] = std::cos(2 * pi * i / kSamples);
  }
  double sum = 0;
  for (int i = 1; i < kFrequencies; ++i) {
    const double weight = i == kFrequencies - 1 ? 0.5 : 1;
    const double amplitude = weight / (i * (1.0 / kSamples));
    sum += amplitude * amplitude;
  }
  deviation_ = 2 * std::sqrt(sum) / kSamples;
}

void BrownNoise::Restart(NumpyGenerator& generator) {
  for (Spectrum* part : {&real_, &imaginary_}) {
    for (int row = 0; row < part->rows(); ++row) {
      for (int i = 0; i < kFrequencies; ++i) {
        // The lowest frequency counts as the one above it.
        (*part)(row, i) = generator.Normal(1 / (std::max(i, 1) * (1.0 / kSamples)));
      }
    }
  }
  for (const int edge : {0, kFrequencies - 1}) real_.col(edge) *= std::sqrt(2.0);
  next_ = 0;
}

// The inverse Fourier transform at one place, from small terms to large ones.
Vector2d BrownNoise::Sample(NumpyGenerator& generator) {
  if (next_ == kSamples) Restart(generator);
  const auto cosine = [&](int64_t phase) { return cosine_[static_cast<size_t>(phase % kSamples)]; };
  Eigen::Array2d sum = real_.col(kFrequencies - 1) * (next_ % 2 == 0 ? 0.5 : -0.5);
  for (int i = kFrequencies - 2; i > 0; --i) {
    const int64_t phase = int64_t{i} * next_;
    sum += real_.col(i) * cosine(phase) - imaginary_.col(i) * cosine(phase + 3 * kSamples / 4);
  }
  sum += real_.col(0) * 0.5;
  ++next_;
  return sum * 2 / kSamples / deviation_;
}

Vector3d Opponent::PoseOf(const mjData& data) {
  Rotation rotation;
  mju_quat2Mat(rotation.data(), data.mocap_quat);
  return {data.mocap_pos[0], data.mocap_pos[1], OfficialEulerAngles(rotation).z()};
}

OpponentPolicy Opponent::DrawPolicy(NumpyGenerator& generator) const {
  const double drawn = generator.Random();
  double below = 0;
  for (const OpponentPolicy policy :
       {OpponentPolicy::kAtTheEdge, OpponentPolicy::kStationary, OpponentPolicy::kRandom}) {
    below += rules_.opponent_shares[static_cast<size_t>(policy)];
    if (drawn < below) return policy;
  }
  return OpponentPolicy::kRepelled;
}

void Opponent::Reset(bool chased, const Vector2d& root, NumpyGenerator& generator, mjData& data) {
  noise_.Restart(generator);
  policy_ = chased ? DrawPolicy(generator) : OpponentPolicy::kChasing;
  constexpr double kFarthest = 5;  // m, on each axis
  Vector3d pose;
  do {
    for (int i = 0; i < 3; ++i) {
      const double limit = i < 2 ? kFarthest : 2 * pi;
      pose[i] = generator.Uniform(-limit, limit);
    }
  } while ((pose.head<2>() - root).norm() < rules_.spawn_distance_m);
  if (policy_ == OpponentPolicy::kAtTheEdge) pose = {0, -kFarthest, 0};
  Place(pose, data);
  velocity_.setZero();
  chase_speed_ = generator.Uniform(rules_.chase_speed[0], rules_.chase_speed[1]);
}

void Opponent::Move(const Vector2d& pelvis, double period, NumpyGenerator& generator,
                    mjData& data) {
  Vector3d pose = PoseOf(data);
  velocity_ = Decide(pose, pelvis, generator);
  velocity_.x() = std::abs(velocity_.x());
  const Vector2d clipped = velocity_.cwiseMax(-kFastest).cwiseMin(kFastest);
  if (!rules_.opponent_speed_unclipped) velocity_ = clipped;
  const double heading = pose.z() + 0.5 * pi;
  pose.head<2>() -= period * (clipped.x() * Vector2d(std::cos(heading), std::sin(heading)));
  pose.z() += period * clipped.y();
  pose.head<2>() = pose.head<2>().cwiseMax(-kLimit).cwiseMin(kLimit).eval();
  Place(pose, data);
}

Vector2d Opponent::Decide(const Vector3d& pose, const Vector2d& pelvis, NumpyGenerator& generator) {
  switch (policy_) {
    case OpponentPolicy::kAtTheEdge:
    case OpponentPolicy::kStationary:
      return Vector2d::Zero();
    case OpponentPolicy::kRandom:
      return (kNoiseScale * noise_.Sample(generator))
          .cwiseMax(rules_.random_speed[0])
          .cwiseMin(rules_.random_speed[1]);
    case OpponentPolicy::kRepelled:
      return Escape(pose, pelvis, generator);
    case OpponentPolicy::kChasing:
      break;
  }
  const Vector2d to_the_right(std::cos(pose.z()), std::sin(pose.z()));
  return {chase_speed_, to_the_right.dot(pelvis - pose.head<2>())};
}

// Away from the mean of what is near, the faster the nearer it is; at random where nothing is.
Vector2d Opponent::Escape(const Vector3d& pose, const Vector2d& pelvis, NumpyGenerator& generator) {
  constexpr double kReach = 3.5;  // m
  constexpr double kStrength = 20;
  Vector2d sum = Vector2d::Zero();
  double force = 0;
  int near = 0;
  for (int i = -1; i < 4 * kWallPoints; ++i) {
    const Vector2d place = i < 0 ? pelvis : WallPoint(i);
    const double distance = (place - pose.head<2>()).norm();
    if (!(distance < kReach)) continue;
    ++near;
    sum += place;
    const double excess = 1 / std::max(distance, 1e-5) - 1 / kReach;
    force += 0.5 * kStrength * (excess * excess);
  }
  const auto speed = [&](double wanted) {
    return std::clamp(wanted, rules_.repelled_speed[0], rules_.repelled_speed[1]);
  };
  if (near == 0) {
    const Vector2d noise = kNoiseScale * noise_.Sample(generator);
    return {speed(noise.x()), Turn(pose.z(), noise.y())};
  }
  Vector2d away = pose.head<2>() - sum / near;
  for (double& part : away) {
    if (std::abs(part) > 0.1) continue;
    const double sign = part > 0 ? 1 : part < 0 ? -1 : 0;
    part = -1 * sign * generator.Uniform(0.3, 0.9);
  }
  constexpr double kQuarter = 1.57;  // rad, as official
  return {speed(force / near), Turn(pose.z(), std::atan2(away.y(), away.x()) + kQuarter)};
}

}  // namespace myograde::sim
