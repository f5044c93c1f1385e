// Labels of what the object touches, by body and in the scene, and their history.
#include "sim/manipulation/contacts.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "tests/sim/manipulation/helpers.h"

namespace myograde::sim {
namespace {

using CountsAs = ManipulationRules::CountsAs;

class Labels : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { env_ = MakeProfile("paper").release(); }
  static void TearDownTestSuite() { delete env_; }
  static ManipulationEnvironment* env_;
};
ManipulationEnvironment* Labels::env_ = nullptr;

ManipulationRules Counting(CountsAs world, CountsAs torso) {
  ManipulationRules rules = RulesOf("paper");
  rules.world_contact = world;
  rules.torso_contact = torso;
  return rules;
}

TEST_F(Labels, EveryBodyHasOne) {
  const Scene& scene = env_->scene();
  const ManipulationRules other = Counting(CountsAs::kOther, CountsAs::kOther);
  const ManipulationRules arm = Counting(CountsAs::kArm, CountsAs::kArm);
  EXPECT_EQ(LabelOf(0, scene, arm), kTouchArm);
  EXPECT_EQ(LabelOf(0, scene, other), kTouchOther);
  EXPECT_EQ(LabelOf(0, scene, Counting(CountsAs::kOther, CountsAs::kArm)), kTouchOther);
  // The body's frame, the thorax and the torso's mesh without a name.
  for (int body = 1; body <= 3; ++body) {
    EXPECT_EQ(LabelOf(body, scene, arm), kTouchArm);
    EXPECT_EQ(LabelOf(body, scene, other), kTouchOther);
    EXPECT_EQ(LabelOf(body, scene, Counting(CountsAs::kArm, CountsAs::kOther)), kTouchOther);
  }
  EXPECT_STREQ(mj_id2name(&env_->model(), mjOBJ_BODY, 4), "clavicle");
  for (int body = 4; body <= 39; ++body) EXPECT_EQ(LabelOf(body, scene, other), kTouchArm);
  for (int body = 40; body <= 69; ++body) {
    EXPECT_EQ(LabelOf(body, scene, other), kTouchProsthesis);
  }
  EXPECT_EQ(LabelOf(71, scene, other), kTouchStart);
  EXPECT_EQ(LabelOf(72, scene, other), kTouchGoal);
  EXPECT_EQ(LabelOf(73, scene, other), kTouchOther);
}

TEST_F(Labels, TheTorsoIsAnythingElseInPaperAndTheArmInTheOfficialCode) {
  EXPECT_EQ(RulesOf("paper").torso_contact, CountsAs::kOther);
  EXPECT_EQ(RulesOf("myosuite").torso_contact, CountsAs::kArm);
  EXPECT_EQ(RulesOf("as-graded").torso_contact, CountsAs::kArm);
  for (const bool paper : {true, false}) {
    const auto env = MakeProfile(paper ? "paper" : "myosuite");
    env->Reset(5);
    // Where the torso's mesh is, which belongs to the third body.
    const mjModel& m = env->model();
    ASSERT_GT(m.body_geomnum[3], 0);
    const mjtNum* torso = env->data().geom_xpos + 3 * m.body_geomadr[3];
    PutObject(*env, {torso[0], torso[1], torso[2]});
    EXPECT_EQ(env->touch()[kTouchOther], paper);
    EXPECT_NE(env->touch()[kTouchArm], paper);
  }
}

TEST_F(Labels, AreSeenWhereTheObjectIsPut) {
  env_->Reset(5);
  const Variation& drawn = env_->variation();
  const auto touched = [&](const Eigen::Vector3d& place) {
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
