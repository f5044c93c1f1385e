#include "sim/locomotion/height_map.h"

#include <Eigen/Core>

namespace myograde::sim {

using Eigen::Vector2d;

void OfficialHeightMap(const Terrain& terrain, const Pose& pose, std::span<double> out) {
  OfficialHeightMap({.heights = terrain.heights(),
                     .rows = terrain.rows(),
                     .columns = terrain.columns(),
                     .row_pitch = 0.2,      // 120 m / 600 rows
                     .column_pitch = 0.05,  // 1 m / 20 columns
                     .view = 5},
                    pose, out);
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
