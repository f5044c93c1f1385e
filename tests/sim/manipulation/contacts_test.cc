// Labels of what the object touches, by body and in the scene, and their history.
#include "sim/manipulation/contacts.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "tests/sim/manipulation/helpers.h"

namespace myograde::sim {
namespace {

using World = ManipulationRules::WorldContact;

class Labels : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { env_ = MakeProfile("paper").release(); }
  static void TearDownTestSuite() { delete env_; }
  static ManipulationEnvironment* env_;
};
ManipulationEnvironment* Labels::env_ = nullptr;

TEST_F(Labels, EveryBodyHasOne) {
  const Scene& scene = env_->scene();
  EXPECT_EQ(LabelOf(0, scene, World::kArm), kTouchArm);
  EXPECT_EQ(LabelOf(0, scene, World::kOther), kTouchOther);
  for (int body = 1; body <= 39; ++body) EXPECT_EQ(LabelOf(body, scene, World::kOther), kTouchArm);
  for (int body = 40; body <= 69; ++body) {
    EXPECT_EQ(LabelOf(body, scene, World::kOther), kTouchProsthesis);
  }
  EXPECT_EQ(LabelOf(71, scene, World::kOther), kTouchStart);
  EXPECT_EQ(LabelOf(72, scene, World::kOther), kTouchGoal);
  EXPECT_EQ(LabelOf(73, scene, World::kOther), kTouchOther);
}

TEST_F(Labels, AreSeenWhereTheObjectIsPut) {
  env_->Reset(5);
  const Variation& drawn = env_->variation();
  const auto touched = [&](std::array<double, 3> place) {
    PutObject(*env_, place);
    return env_->touch();
  };
  // Upright, the box is as high as its depth; it reaches a little into the pillar's top.
  const double above_pillar = 1.09 + drawn.half_size[1] - 0.001;
  EXPECT_EQ(touched({drawn.start[0], drawn.start[1], above_pillar}),
            (TouchFrame{false, false, true, false, false}));
  EXPECT_EQ(touched({drawn.goal[0], drawn.goal[1], above_pillar}),
            (TouchFrame{false, false, false, true, false}));
  EXPECT_EQ(touched({2, 2, -0.36}), (TouchFrame{false, false, false, false, true}));
  EXPECT_EQ(touched({0, -0.6, 1.6}), (TouchFrame{}));
  const mjtNum* finger = env_->data().xpos + 3 * 27;  // a fingertip's body
  EXPECT_TRUE(touched({finger[0], finger[1], finger[2]})[kTouchArm]);
  const mjtNum* palm = env_->data().xpos + 3 * 49;  // the prosthesis' palm
  EXPECT_TRUE(touched({palm[0], palm[1], palm[2]})[kTouchProsthesis]);
}

TEST_F(Labels, ForceIsZeroInTheAirAndTheWeightAtRest) {
  env_->Reset(5);
  PutObject(*env_, {0, -0.6, 1.6});
  EXPECT_EQ(ObjectForce(env_->model(), env_->data(), env_->scene()), 0);
  const Variation& drawn = env_->variation();
  PutObject(*env_, {drawn.goal[0], drawn.goal[1], 1.09 + drawn.half_size[1]});
  std::vector<double> zeros(env_->action_size(), 0.0);
  for (int i = 0; i < 60; ++i) env_->Step(zeros);
  EXPECT_NEAR(ObjectForce(env_->model(), env_->data(), env_->scene()), drawn.mass * 9.81, 0.05);
}

TouchFrame Frame(bool arm, bool prosthesis, bool start, bool goal, bool other) {
  return {arm, prosthesis, start, goal, other};
}

TEST(ContactHistory, CountsEachLabel) {
  ContactHistory history(2);
  history.Add(Frame(true, false, true, false, false));
  history.Add(Frame(true, true, false, false, false));
  history.Add(Frame(false, false, false, false, true));
  history.Add(Frame(false, false, false, false, false));
  ManipulationFacts facts;
  history.Report(facts);
  EXPECT_EQ(facts.frames, 4);
  EXPECT_EQ(facts.frames_arm, 2);
  EXPECT_EQ(facts.frames_prosthesis, 1);
  EXPECT_EQ(facts.frames_start, 1);
  EXPECT_EQ(facts.frames_goal, 0);
  EXPECT_EQ(facts.frames_other, 1);
  EXPECT_FALSE(facts.goal_only_at_end);
  history.Clear();
  history.Report(facts);
  EXPECT_EQ(facts.frames, 0);
  EXPECT_EQ(facts.frames_arm, 0);
}

RC_GTEST_PROP(ContactHistory, GoalOnlyMeansTheLastFramesInARow, ()) {
  const auto goal_only = *rc::gen::container<std::vector<bool>>(
      rc::gen::weightedElement<bool>({{6, true}, {1, false}}));
  const int hold = *rc::gen::inRange(1, 10);
  ContactHistory history(hold);
  int run = 0;
  for (const bool goal : goal_only) {
    history.Add(Frame(!goal, false, false, true, false));
    run = goal ? run + 1 : 0;
  }
  ManipulationFacts facts;
  history.Report(facts);
  RC_ASSERT(facts.goal_only_at_end == (run >= hold));
}

}  // namespace
}  // namespace myograde::sim
