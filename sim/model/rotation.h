// Rotations as MuJoCo keeps them, and the angles that the official code takes from them.
#pragma once

#include <cmath>
#include <limits>

#include <Eigen/Core>

namespace myograde::sim {

using Rotation = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

// Roll, pitch and yaw in rad, with the official signs and its way out where the pitch is upright.
// The yaw is not the heading of something that leans.
inline Eigen::Vector3d OfficialEulerAngles(const Rotation& r) {
  const double cosine = r.col(2).tail<2>().norm();
  const double pitch = -std::atan2(-r(0, 2), cosine);
  if (cosine > 4 * std::numeric_limits<double>::epsilon()) {
    return {-std::atan2(r(1, 2), r(2, 2)), pitch, -std::atan2(r(0, 1), r(0, 0))};
  }
  return {0, pitch, -std::atan2(-r(1, 0), r(1, 1))};
}

// The quaternion w, x, y, z of roll, pitch and yaw, as the official code computes it.
inline Eigen::Vector4d OfficialQuaternion(const Eigen::Vector3d& euler) {
  const double i = euler.z() / 2, j = -euler.y() / 2, k = euler.x() / 2;
  const double si = std::sin(i), sj = std::sin(j), sk = std::sin(k);
  const double ci = std::cos(i), cj = std::cos(j), ck = std::cos(k);
  const double cc = ci * ck, cs = ci * sk, sc = si * ck, ss = si * sk;
  return {cj * cc + sj * ss, cj * cs - sj * sc, -(cj * ss + sj * cc), cj * sc - sj * cs};
}

}  // namespace myograde::sim
