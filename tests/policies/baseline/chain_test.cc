// The arms' chains against the model, and the way to a pose.
#include "policies/baseline/chain.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "sim/manipulation/track.h"
#include "sim/model/model.h"
#include "tests/sim/golden.h"

namespace myograde::baseline {
namespace {

using Names = std::array<const char*, kChainAngles>;

constexpr Names kMuscleArm = {"elv_angle", "shoulder_elv", "shoulder_rot", "elbow_flexion",
                              "pro_sup",   "deviation",    "flexion"};
constexpr Names kProstheticArm = {"prosthesis/Lshoulder_fe", "prosthesis/Lshoulder_abad",
                                  "prosthesis/Lhumeral_rot", "prosthesis/Lelbow",
                                  "prosthesis/wrist_PRO",    "prosthesis/wrist_UDEV",
                                  "prosthesis/wrist_FLEX"};

class ChainTest : public testing::Test {
 protected:
  void SetUp() override {
    auto model = sim::LoadModel(sim::ManipulationModel(), sim::CacheDir());
    ASSERT_TRUE(model.ok()) << model.status();
    model_ = *std::move(model);
    data_.reset(mj_makeData(model_.get()));
  }

  // Sets the joints, and those that equalities couple to them.
  void Pose(const Names& names, const ChainAngles& angles) {
    const mjModel& m = *model_;
    for (int j = 0; j < kChainAngles; ++j) {
      joint_[j] = mj_name2id(&m, mjOBJ_JOINT, names[j]);
      ASSERT_GE(joint_[j], 0) << names[j];
      data_->qpos[m.jnt_qposadr[joint_[j]]] = angles[j];
    }
    for (int i = 0; i < m.neq; ++i) {
      const auto driver = std::ranges::find(joint_, m.eq_obj2id[i]);
      if (m.eq_type[i] != mjEQ_JOINT || driver == joint_.end()) continue;
      const double ratio = m.eq_data[i * mjNEQDATA + 1];
      data_->qpos[m.jnt_qposadr[m.eq_obj1id[i]]] = ratio * angles[driver - joint_.begin()];
      coupled_.push_back({m.eq_obj1id[i], static_cast<int>(driver - joint_.begin()), ratio});
    }
    mj_forward(&m, data_.get());
  }

  struct Coupled {
    int joint, driver;
    double ratio;
  };

  sim::ModelPtr model_;
  sim::DataPtr data_;
  std::array<int, kChainAngles> joint_{};
  std::vector<Coupled> coupled_;
};

TEST_F(ChainTest, TheMusclesArmIsTheModels) {
  const ChainAngles angles = {0.5, 0.8, -0.4, 0.8, 0.3, 0.2, 0.5};
  Pose(kMuscleArm, angles);
  const mjtNum* site = data_->site_xpos + 3 * mj_name2id(model_.get(), mjOBJ_SITE, "S_grasp");
  const auto pose = MuscleArm().Of(angles);
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(pose.place[i], site[i], 1e-4);
}

TEST_F(ChainTest, TheProsthesisIsTheModels) {
  const ChainAngles angles = {0.8, -0.3, 0.9, 1.2, 0.7, 0.1, 0.3};
  Pose(kProstheticArm, angles);
  const int palm = mj_name2id(model_.get(), mjOBJ_BODY, "prosthesis/palm");
  const auto pose = ProstheticArm().Of(angles);
  const mjtNum* turn = data_->xquat + 4 * palm;
  const Eigen::Quaterniond of_model(turn[0], turn[1], turn[2], turn[3]);
  EXPECT_LT(pose.turn.angularDistance(of_model), 1e-3);
  const Eigen::Vector3d origin(data_->xpos + 3 * palm);
  EXPECT_NEAR((pose.place - origin).norm(), Eigen::Vector3d(0.0205, -0.042, -0.05).norm(), 1e-4);
}

TEST_F(ChainTest, TheMusclesArmHasTheModelsInertia) {
  const ChainAngles angles = {0.5, 0.8, -0.4, 0.8, 0.3, 0.2, 0.5};
  Pose(kMuscleArm, angles);
  const mjModel& m = *model_;
  std::vector<mjtNum> full(static_cast<size_t>(m.nv) * m.nv);
  mj_fullM(&m, full.data(), data_->qM);
  // How the model's velocities follow from the chain's.
  Eigen::MatrixXd follow = Eigen::MatrixXd::Zero(m.nv, kChainAngles);
  for (int j = 0; j < kChainAngles; ++j) follow(m.jnt_dofadr[joint_[j]], j) = 1;
  for (const Coupled& c : coupled_) follow(m.jnt_dofadr[c.joint], c.driver) = c.ratio;
  const Eigen::Map<Eigen::Matrix<mjtNum, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> mass(
      full.data(), m.nv, m.nv);
  const Eigen::MatrixXd of_model = follow.transpose() * mass * follow;
  const ChainInertia inertia = MuscleArm().Inertia(angles);
  for (int i = 0; i < kChainAngles; ++i) {
    // The hand's fingers are lumped to its palm.
    EXPECT_NEAR(inertia(i, i), of_model(i, i), 0.1 * of_model(i, i) + 0.001) << kMuscleArm[i];
  }
}

TEST(Chain, StepsLeadToAPoseWithinReach) {
  const ChainAngles there = {0.9, 0.6, 0.1, 1.2, 0.1, 0.2, 0.4};
  const Pose goal = MuscleArm().Of(there);
  ChainAngles angles = {0.5, 0.8, -0.4, 0.8, 0.3, 0.2, 0.5};
  for (int i = 0; i < 200; ++i) angles = MuscleArm().Nearer(angles, goal, 0.12, angles);
  const Pose reached = MuscleArm().Of(angles);
  EXPECT_LT((reached.place - goal.place).norm(), 0.002);
  EXPECT_LT(reached.turn.angularDistance(goal.turn), 0.02);
}

TEST(Chain, AnAngleThatIsNotUsedStays) {
  const Pose goal = MuscleArm().Of({0.9, 0.6, 0.1, 1.2, 0.1, 0.2, 0.4});
  const ChainAngles first = {0.5, 0.8, -0.4, 0.8, 0.3, 0.2, 0.5};
  const ChainAngles next = MuscleArm().Nearer(first, goal, 0.12, first, {0, 1, 1, 1, 1, 1, 1});
  EXPECT_EQ(next[0], first[0]);
  EXPECT_NE(next[1], first[1]);
}

TEST(Chain, APoseOutOfReachLeavesAnglesWithinTheirRanges) {
  Pose far;
  far.place = {3, 3, 3};
  ChainAngles angles = {0.5, 0.8, -0.4, 0.8, 0.3, 0.2, 0.5};
  for (int i = 0; i < 500; ++i) angles = ProstheticArm().Nearer(angles, far, 0, angles);
  for (const double angle : angles) {
    EXPECT_TRUE(std::isfinite(angle));
    EXPECT_LE(std::abs(angle), 2.8);
  }
}

}  // namespace
}  // namespace myograde::baseline
