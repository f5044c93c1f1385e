// When the object was touched by whom, from frames, and in an episode.
#include "sim/manipulation/object_times.h"

#include <gtest/gtest.h>

#include "tests/sim/manipulation/helpers.h"

namespace myograde::sim {
namespace {

// Frames at 1, 2, 3, … s: a for the arm, p for the prosthesis, g for the goal, - for nothing.
ManipulationDetails After(const std::vector<std::string>& frames) {
  ObjectTimes times;
  double time = 0;
  for (const std::string& text : frames) {
    TouchFrame frame = {};
    frame[kTouchArm] = text.find('a') != std::string::npos;
    frame[kTouchProsthesis] = text.find('p') != std::string::npos;
    frame[kTouchGoal] = text.find('g') != std::string::npos;
    times.AddFrame(time += 1, frame);
  }
  ManipulationDetails details;
  times.Report(details);
  return details;
}

TEST(ObjectTimes, OfAHandoverAreInOrder) {
  const ManipulationDetails details = After({"-", "a", "-", "a", "ap", "ap", "p", "p", "pg", "g"});
  EXPECT_EQ(details.first_contact_time, 2);
  EXPECT_EQ(details.handover_time, 5);
  EXPECT_EQ(details.release_time, 6);
  EXPECT_EQ(details.goal_contact_time, 9);
  EXPECT_EQ(details.peak_force_time, std::nullopt);
}

TEST(ObjectTimes, AreNoneWhereItNeverCameToThat) {
  const ManipulationDetails nothing = After({"-", "-"});
  EXPECT_EQ(nothing.first_contact_time, std::nullopt);
  EXPECT_EQ(nothing.goal_contact_time, std::nullopt);
  const ManipulationDetails arm = After({"a", "ag", "-"});
  EXPECT_EQ(arm.handover_time, std::nullopt);
  EXPECT_EQ(arm.release_time, std::nullopt);
  EXPECT_EQ(arm.goal_contact_time, 2);
  EXPECT_EQ(After({"a", "ap", "ap"}).release_time, std::nullopt) << "it never lets go";
  EXPECT_EQ(After({"a", "ap", "-"}).release_time, std::nullopt) << "nobody holds it";
}

TEST(ObjectTimes, TheProsthesisAloneIsNoHandover) {
  const ManipulationDetails details = After({"p", "p", "a", "p"});
  EXPECT_EQ(details.first_contact_time, 3);
  EXPECT_EQ(details.handover_time, 4);
  EXPECT_EQ(details.release_time, 3);
  EXPECT_EQ(After({"p", "p"}).handover_time, std::nullopt);
}

TEST(ObjectTimes, AReleaseIsTheArmsLastTouchAtAll) {
  EXPECT_EQ(After({"a", "ap", "p", "ap", "p", "p"}).release_time, 4);
  EXPECT_EQ(After({"a", "ap", "p", "a", "-"}).release_time, std::nullopt) << "taken back";
}

TEST(ManipulationDetails, OfAnEpisode) {
  const auto env = MakeProfile("paper");
  env->Reset(3);
  EXPECT_FALSE(env->details().has_value());
  const std::vector<double> action(80, 0.0);
  StepResult result;
  for (int i = 0; i < 60 && !result.ended; ++i) result = env->Step(action);
  const auto facts = std::get<ManipulationFacts>(env->facts().track);
  const auto details = std::get<ManipulationDetails>(env->details().value());
  // Nobody moves: the object falls onto the start pillar.
  EXPECT_GT(facts.peak_force, 0);
  ASSERT_TRUE(details.peak_force_time.has_value());
  EXPECT_GT(*details.peak_force_time, 0.05);
  EXPECT_LE(*details.peak_force_time, env->facts().sim_time);
  EXPECT_EQ(details.first_contact_time.has_value(), facts.frames_arm > 0);
  EXPECT_EQ(details.goal_contact_time, std::nullopt);
  for (size_t i = 0; i < details.joint_ranges.size(); ++i) {
    const JointRange& range = details.joint_ranges[i];
    EXPECT_LE(range.low, range.high) << ManipulationDetails::kJoints[i];
    EXPECT_LT(range.limit_low, range.limit_high) << ManipulationDetails::kJoints[i];
  }
  EXPECT_STREQ(ManipulationDetails::kJoints[3].data(), "elbow_flexion");
  const double elbow = env->data().qpos[env->scene().elbow_qpos];
  EXPECT_LE(details.joint_ranges[3].low, elbow);
  EXPECT_GE(details.joint_ranges[3].high, elbow);
  env->Reset(3);
  EXPECT_FALSE(env->details().has_value());
}

TEST(ManipulationDetails, TheGoalIsTouchedInTheStepThatSaysSo) {
  const auto env = MakeProfile("paper");
  env->Reset(3);
  const Variation& drawn = env->variation();
  PutObject(*env, {drawn.goal[0], drawn.goal[1],
                   env->rules().goal_face_m + drawn.half_size[1] - 0.0005});
  env->Step(std::vector<double>(80, 0.0));
  ASSERT_EQ(std::get<ManipulationFacts>(env->facts().track).frames_goal, 1);
  const auto details = std::get<ManipulationDetails>(env->details().value());
  EXPECT_EQ(details.goal_contact_time, env->facts().sim_time);
}

}  // namespace
}  // namespace myograde::sim
