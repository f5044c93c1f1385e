// The 10 x 10 heights of the ground around a person that official observations hold. Row 0 lies
// ahead, column 0 to the left; entry 10 i + j.
#pragma once

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <span>

#include "sim/model/rotation.h"

namespace myograde::sim {

inline constexpr int kHeightMapSize = 10;

// Where the person is: x and y of the root in m and its normalised quaternion
// (w, x, y, z); the root's x axis looks ahead.
struct Pose {
  Eigen::Vector2d place;
  const double* quaternion;
};

inline Rotation RotationOf(const Pose& pose) {
  Rotation rotation;
  mju_quat2Mat(rotation.data(), pose.quaternion);
  return rotation;
}

// Heights in m, row by row, and the cells by which the official code looks them up: rows along y,
// columns along x, the middle of the grid at the world's origin.
struct HeightGrid {
  std::span<const float> heights;
  int rows, columns;
  double row_pitch, column_pitch;  // m
  double view;                     // what a step of 0.1 in the map is multiplied by

  // Truncates towards zero to a row or column that has a next one. Clamped before the conversion,
  // so that no number is too large for it.
  static int Index(double at, double pitch, int count) {
    const int middle = count / 2;
    return static_cast<int>(std::clamp(at / pitch + middle, 0.0, static_cast<double>(count - 2)));
  }
  int Row(double y) const { return Index(y, row_pitch, rows); }
  int Column(double x) const { return Index(x, column_pitch, columns); }
};

// As the official code does it: raw heights, 5 steps ahead and left of the person to 4 behind and
// right.
inline void OfficialHeightMap(const HeightGrid& grid, const Pose& pose, std::span<double> out) {
  constexpr std::array<double, kHeightMapSize> kOffsets = {-0.4, -0.3, -0.2, -0.1, 0.0,
                                                           0.1,  0.2,  0.3,  0.4,  0.5};
  const Eigen::Rotation2Dd yaw(OfficialEulerAngles(RotationOf(pose)).z());
  const Eigen::Matrix2d turn = yaw.toRotationMatrix();
  for (int i = 0; i < kHeightMapSize; ++i) {
    for (int j = 0; j < kHeightMapSize; ++j) {
      const Eigen::Vector2d ahead_and_left(kOffsets[kHeightMapSize - 1 - i],
                                           kOffsets[kHeightMapSize - 1 - j]);
      const Eigen::Vector2d at = turn * ahead_and_left * grid.view + pose.place;
      const int cell = grid.Row(at.y()) * grid.columns + grid.Column(at.x());
      out[kHeightMapSize * i + j] = grid.heights[static_cast<size_t>(cell)];
    }
  }
}

}  // namespace myograde::sim
