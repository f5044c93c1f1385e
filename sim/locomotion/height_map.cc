#include "sim/locomotion/height_map.h"

#include <algorithm>
#include <array>

#include <Eigen/Geometry>
#include <mujoco/mujoco.h>

#include "sim/model/rotation.h"

namespace myograde::sim {
namespace {

using Eigen::Vector2d;

Rotation RotationOf(const Pose& pose) {
  Rotation rotation;
  mju_quat2Mat(rotation.data(), pose.quaternion);
  return rotation;
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
  const Eigen::Rotation2Dd yaw(OfficialEulerAngles(RotationOf(pose)).z());
  const Eigen::Matrix2d turn = yaw.toRotationMatrix();
  const int middle_row = terrain.rows() / 2;
  const int middle_column = terrain.columns() / 2;
  for (int i = 0; i < kHeightMapSize; ++i) {
    for (int j = 0; j < kHeightMapSize; ++j) {
      const Vector2d ahead_and_left(kOffsets[kHeightMapSize - 1 - i],
                                    kOffsets[kHeightMapSize - 1 - j]);
      const Vector2d at = turn * ahead_and_left * kViewDistance + pose.place;
      const int row = GridIndex(at.y() / kRowPitch + middle_row, terrain.rows() - 2);
      const int column =
          GridIndex(at.x() / kColumnPitch + middle_column, terrain.columns() - 2);
      out[kHeightMapSize * i + j] = terrain.at(row, column);
    }
  }
}

void HeadingHeightMap(const Terrain& terrain, const Pose& pose, double pitch,
                      std::span<double> out) {
  const Vector2d heading = RotationOf(pose).col(0).head<2>();
  const double length = heading.norm();
  // Looking straight up or down there is no heading: take the course's.
  const Vector2d ahead = length > 1e-9 ? Vector2d(heading / length) : Vector2d(0, -1);
  const Vector2d left(-ahead.y(), ahead.x());
  const double under = terrain.GroundAt(pose.place.x(), pose.place.y());
  constexpr double kMiddle = (kHeightMapSize - 1) / 2.0;
  for (int i = 0; i < kHeightMapSize; ++i) {
    for (int j = 0; j < kHeightMapSize; ++j) {
      const Vector2d at =
          pose.place + ahead * ((kMiddle - i) * pitch) + left * ((kMiddle - j) * pitch);
      out[kHeightMapSize * i + j] = terrain.GroundAt(at.x(), at.y()) - under;
    }
  }
}

}  // namespace myograde::sim
