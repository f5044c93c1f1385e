// Just enough of rotations for a walking body.
#pragma once

#include <array>
#include <cmath>

namespace myograde::baseline {

using Vector = std::array<double, 3>;

inline Vector operator+(const Vector& a, const Vector& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}

// A unit quaternion w + xi + yj + zk.
struct Quaternion {
  double w = 1, x = 0, y = 0, z = 0;

  Quaternion Conjugate() const { return {w, -x, -y, -z}; }

  friend Quaternion operator*(const Quaternion& a, const Quaternion& b) {
    return {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
            a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
            a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
            a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
  }

  // A vector of this frame in the outer one.
  Vector Turn(const Vector& v) const {
    const Quaternion turned = *this * Quaternion{0, v[0], v[1], v[2]} * Conjugate();
    return {turned.x, turned.y, turned.z};
  }
};

// A turn by `angle` rad about the x, y or z axis (0, 1 or 2).
inline Quaternion About(int axis, double angle) {
  const double c = std::cos(angle / 2), s = std::sin(angle / 2);
  return {c, axis == 0 ? s : 0, axis == 1 ? s : 0, axis == 2 ? s : 0};
}

// The same angle in (-pi, pi].
inline double Wrapped(double angle) { return std::atan2(std::sin(angle), std::cos(angle)); }

}  // namespace myograde::baseline
