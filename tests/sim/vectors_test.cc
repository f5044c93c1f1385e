// What the tracks share of vectors and rotations.
#include <numbers>
#include <random>
#include <vector>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "sim/model/rotation.h"
#include "sim/model/state.h"

namespace myograde::sim {
namespace {

using Eigen::AngleAxisd;
using Eigen::Vector3d;

template <typename Vector>
double SumInOrder(const Vector& vector) {
  double sum = 0;
  for (const double entry : vector) sum += entry;
  return sum;
}

// Digests hang on the last bit of a sum. By default Eigen adds up by packets or by halves, as the
// processor and the size have it.
TEST(Vectors, AreAddedUpFromTheFirstEntryToTheLast) {
  std::mt19937_64 bits(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  Eigen::VectorXd all(54);
  for (int i = 0; i < 100; ++i) {
    for (double& entry : all) entry = uniform(bits);
    const Vector3d few = all.head<3>();
    EXPECT_EQ(all.sum(), SumInOrder(all));
    EXPECT_EQ(all.head<12>().sum(), SumInOrder(all.head<12>()));
    EXPECT_EQ(few.sum(), SumInOrder(few));
    EXPECT_EQ(few.squaredNorm(), few.x() * few.x() + few.y() * few.y() + few.z() * few.z());
  }
}

TEST(Rotation, HasTheOfficialAngles) {
  const auto expect_angles = [](const Rotation& rotation, const Vector3d& angles) {
    EXPECT_LT((OfficialEulerAngles(rotation) - angles).norm(), 1e-12);
  };
  expect_angles(Rotation::Identity(), {0, 0, 0});
  expect_angles(AngleAxisd(0.3, Vector3d::UnitX()).toRotationMatrix(), {0.3, 0, 0});
  expect_angles(AngleAxisd(0.3, Vector3d::UnitY()).toRotationMatrix(), {0, 0.3, 0});
  expect_angles(AngleAxisd(0.3, Vector3d::UnitZ()).toRotationMatrix(), {0, 0, 0.3});
  Rotation upright;
  upright << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  expect_angles(upright, {0, std::numbers::pi / 2, 0});
}

TEST(State, IsTimePositionsVelocitiesAndActivations) {
  double qpos[] = {2, 3}, qvel[] = {4}, act[] = {5, 6, 7};
  mjModel model = {};
  model.nq = 2;
  model.nv = 1;
  model.na = 3;
  mjData data = {};
  data.time = 1;
  data.qpos = qpos;
  data.qvel = qvel;
  data.act = act;
  std::vector<double> state;
  CopyState(model, data, state);
  EXPECT_EQ(state, (std::vector<double>{1, 2, 3, 4, 5, 6, 7}));
}

}  // namespace
}  // namespace myograde::sim
