#include "sim/locomotion/height_map.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace myograde::sim {
namespace {

// Entries of the rotation matrix of a unit quaternion, as MuJoCo computes them.
struct Rotation {
  double r00, r01, r10, r11, r12, r22;
};

Rotation Rotate(const double* q) {
  const double w = q[0], x = q[1], y = q[2], z = q[3];
  return {.r00 = w * w + x * x - y * y - z * z,
          .r01 = 2 * (x * y - w * z),
          .r10 = 2 * (x * y + w * z),
          .r11 = w * w - x * x + y * y - z * z,
          .r12 = 2 * (y * z - w * x),
          .r22 = w * w - x * x - y * y + z * z};
}

// The official code's yaw: the third Euler angle of its decomposition, which is
// not the heading when the person leans.
double OfficialYaw(const double* quaternion) {
  constexpr double kSingular = 4 * 2.220446049250313e-16;
  const Rotation r = Rotate(quaternion);
  const double cos_pitch = std::sqrt(r.r22 * r.r22 + r.r12 * r.r12);
  return cos_pitch > kSingular ? -std::atan2(r.r01, r.r00) : -std::atan2(-r.r10, r.r11);
}

// Truncates towards zero to a grid index. Clamped before the conversion, so
// that no number is too large for it.
int GridIndex(double value, int last) {
  return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(last)));
}

}  // namespace

void OfficialHeightMap(const Terrain& terrain, const Pose& pose, std::span<double> out) {
  constexpr std::array<double, kHeightMapSize> kOffsets = {-0.4, -0.3, -0.2, -0.1, 0.0,
                                                           0.1,  0.2,  0.3,  0.4,  0.5};
  constexpr double kViewDistance = 5;
  constexpr double kRowPitch = 0.2;      // 120 m / 600 rows
  constexpr double kColumnPitch = 0.05;  // 1 m / 20 columns
  const double yaw = OfficialYaw(pose.quaternion);
  const double cosine = std::cos(yaw);
  const double sine = std::sin(yaw);
  for (int i = 0; i < kHeightMapSize; ++i) {
    for (int j = 0; j < kHeightMapSize; ++j) {
      const double ahead = kOffsets[kHeightMapSize - 1 - i];
      const double left = kOffsets[kHeightMapSize - 1 - j];
      const double x = (cosine * ahead - sine * left) * kViewDistance + pose.x;
      const double y = (sine * ahead + cosine * left) * kViewDistance + pose.y;
      const int row = GridIndex(y / kRowPitch + terrain.rows() / 2, terrain.rows() - 2);
      const int column = GridIndex(x / kColumnPitch + terrain.columns() / 2, terrain.columns() - 2);
      out[kHeightMapSize * i + j] = terrain.at(row, column);
    }
  }
}

void HeadingHeightMap(const Terrain& terrain, const Pose& pose, double pitch,
                      std::span<double> out) {
  const Rotation r = Rotate(pose.quaternion);
  const double length = std::sqrt(r.r00 * r.r00 + r.r10 * r.r10);
  // Looking straight up or down there is no heading: take the course's.
  const double forward_x = length > 1e-9 ? r.r00 / length : 0;
  const double forward_y = length > 1e-9 ? r.r10 / length : -1;
  const double under = terrain.GroundAt(pose.x, pose.y);
  constexpr double kMiddle = (kHeightMapSize - 1) / 2.0;
  for (int i = 0; i < kHeightMapSize; ++i) {
    for (int j = 0; j < kHeightMapSize; ++j) {
      const double ahead = (kMiddle - i) * pitch;
      const double left = (kMiddle - j) * pitch;
      const double x = pose.x + forward_x * ahead - forward_y * left;
      const double y = pose.y + forward_y * ahead + forward_x * left;
      out[kHeightMapSize * i + j] = terrain.GroundAt(x, y) - under;
    }
  }
}

}  // namespace myograde::sim
