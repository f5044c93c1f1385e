// How episodes end, and what is reported of them, in hand-made states.
#include <cmath>
#include <numbers>
#include <vector>

#include <gtest/gtest.h>

#include "tests/sim/locomotion/fixture.h"

namespace myograde::sim {
namespace {

// An episode on a course of one kind, with the person put somewhere else.
class Probe {
 public:
  Probe(const std::string& profile, const std::string& kind, double time_limit = 300) {
    nlohmann::json rules = ShippedRules(profile);
    rules["course"]["kinds"] = {kind};
    rules["end"]["time_limit_s"] = time_limit;
    environment_ = MakeEnvironment(ParsedRules(rules));
    environment_->Reset(1);
    const mjModel& m = environment_->model();
    qpos_.assign(environment_->data().qpos, environment_->data().qpos + m.nq);
    qvel_.assign(m.nv, 0.0);
    act_.assign(m.na, 0.0);
  }

  // Root to (x, y), `lift` m above where it stands on level ground, upright
  // or leaning by `lean` rad.
  StepResult StepAt(double x, double y, double lift = 0, double lean = 0) {
    std::vector<double> qpos = qpos_;
    qpos[0] = x;
    qpos[1] = y;
    qpos[2] += lift;
    const double axis[3] = {0, 1, 0};
    double turn[4];
    double start[4] = {std::sqrt(0.5), 0, 0, -std::sqrt(0.5)};  // faces -y
    mju_axisAngle2Quat(turn, axis, lean);
    mju_mulQuat(&qpos[3], start, turn);
    environment_->SetState({0, qpos, qvel_, act_, {}, {}});
    return environment_->Step(ConstantAction(-1));
  }

  EpisodeFacts facts() const { return environment_->facts(); }
  LocomotionFacts walk() const { return std::get<LocomotionFacts>(facts().track); }
  LocomotionDetails details() const {
    return std::get<LocomotionDetails>(environment_->details().value());
  }
  LocomotionEnvironment& environment() { return *environment_; }
  std::vector<double>& qpos() { return qpos_; }

 private:
  std::unique_ptr<LocomotionEnvironment> environment_;
  std::vector<double> qpos_, qvel_, act_;
};

TEST(PaperEnds, GoesOnWhileUprightOnTheTrack) {
  Probe probe("paper", "flat");
  EXPECT_FALSE(probe.StepAt(1.49, 55.9).ended);
  EXPECT_FALSE(probe.StepAt(-1.49, -44.9).ended);
  EXPECT_NEAR(probe.walk().distance, 99.9, 0.01);
}

TEST(PaperEnds, FinishesAfterAHundredMetres) {
  Probe probe("paper", "flat");
  EXPECT_TRUE(probe.StepAt(0, -45.001).ended);
  EXPECT_EQ(probe.facts().end, LocomotionEnd::kFinished);
  EXPECT_EQ(probe.walk().distance, 100);
  EXPECT_TRUE(probe.walk().solved);
  EXPECT_DOUBLE_EQ(probe.walk().reported_time, probe.facts().sim_time);
}

TEST(PaperEnds, LeavesTheTrackAtTheSidesAndBehind) {
  for (const auto& [x, y] : std::vector<std::pair<double, double>>{
           {1.51, 40}, {-1.51, 40}, {0, 56.01}}) {
    Probe probe("paper", "flat");
    EXPECT_TRUE(probe.StepAt(x, y).ended) << x << " " << y;
    EXPECT_EQ(probe.facts().end, LocomotionEnd::kOffTrack) << x << " " << y;
  }
}

TEST(PaperEnds, FallsWhenTheHeadIsLow) {
  Probe probe("paper", "flat");
  EXPECT_FALSE(probe.StepAt(0, 40, 0, 0.8).ended);
  EXPECT_TRUE(probe.StepAt(0, 40, 0, 1.3).ended);
  EXPECT_EQ(probe.facts().end, LocomotionEnd::kFell);
  EXPECT_DOUBLE_EQ(probe.walk().reported_time, probe.facts().sim_time);
}

TEST(PaperEnds, MeasuresTheHeadFromTheGroundUnderThePelvis) {
  // On the top of the last hill, 1.5 m up: leaning so far that the head is
  // low above the hill but high above the plane.
  Probe hill("paper", "hilly");
  EXPECT_FALSE(hill.StepAt(0, 55 - 97.5, 1.6, 0.3).ended);
  EXPECT_TRUE(hill.StepAt(0, 55 - 97.5, 1.6, 1.45).ended);
  EXPECT_EQ(hill.facts().end, LocomotionEnd::kFell);
  const mjData& data = hill.environment().data();
  EXPECT_GT(data.site_xpos[3 * hill.environment().indices().head_site + 2], 1.5);
}

TEST(PaperEnds, FallsWhenTheFeetAreAsHighAsTheHead) {
  // In the air, head down: the head is 1.5 m above the ground, the feet higher.
  Probe probe("paper", "flat");
  EXPECT_TRUE(probe.StepAt(0, 40, 4, 2.6).ended);
  EXPECT_EQ(probe.facts().end, LocomotionEnd::kFell);
}

TEST(PaperEnds, TimeRunsOutAfterItsSteps) {
  Probe probe("paper", "flat", 0.02);
  probe.environment().Reset(1);
  for (int t = 0; t < 3; ++t) ASSERT_FALSE(probe.environment().Step(ConstantAction(0)).ended);
  EXPECT_TRUE(probe.environment().Step(ConstantAction(0)).ended);
  EXPECT_EQ(probe.facts().end, EpisodeEnd::kTime);
  EXPECT_EQ(probe.facts().steps, 4);
}

TEST(PaperEnds, DistanceIsTheLargestProgress) {
  Probe probe("paper", "flat");
  probe.StepAt(0, 30);
  probe.StepAt(0, 33);
  EXPECT_NEAR(probe.walk().distance, 25, 0.01);
  EXPECT_NEAR(probe.walk().final_y, 33, 0.01);
}

TEST(MyosuiteEnds, AbsoluteHeadNarrowTrackAndTimeOfALoss) {
  Probe hill("myosuite", "hilly");
  EXPECT_TRUE(hill.StepAt(1.01, 40).ended);
  EXPECT_EQ(hill.facts().end, LocomotionEnd::kOffTrack);
  EXPECT_EQ(hill.walk().reported_time, 300);
  // The same step reaches the end and leaves the track: solved, with the time of a loss.
  Probe both("myosuite", "hilly");
  EXPECT_TRUE(both.StepAt(1.2, -45.5).ended);
  EXPECT_EQ(both.facts().end, LocomotionEnd::kFinished);
  EXPECT_TRUE(both.walk().solved);
  EXPECT_EQ(both.walk().reported_time, 300);
  EXPECT_EQ(both.walk().distance, 100);
}

TEST(MyosuiteEnds, DistanceCountsFromOneMetreAheadOfTheStart) {
  Probe probe("myosuite", "hilly");
  EXPECT_FALSE(probe.StepAt(0, 58.5).ended);
  EXPECT_EQ(probe.walk().distance, 0);
  probe.StepAt(0, 58 - 51.5);
  EXPECT_NEAR(probe.walk().distance, 50, 0.01);
}

TEST(Pain, ComesFromJointLimitsAndIsClipped) {
  Probe probe("paper", "flat");
  probe.StepAt(0, 40, 2);
  const double none = probe.environment().terms().pain;
  const LocomotionIndices& at = probe.environment().indices();
  probe.qpos()[at.joint_qpos[6]] = 2.4;  // the sound knee, beyond its limit
  probe.StepAt(0, 40, 2);
  const double some = probe.environment().terms().pain;
  EXPECT_GT(some, none + 1e-4);
  // All twelve joints at the clip make 1.
  for (const int address : at.joint_qpos) probe.qpos()[address] = 9;
  probe.StepAt(0, 40, 2);
  const double most = probe.environment().terms().pain;
  EXPECT_GT(most, some);
  EXPECT_LE(most, 1);
}

TEST(Pain, OfEachJointAddsUpToTheSum) {
  Probe probe("paper", "flat");
  const LocomotionIndices& at = probe.environment().indices();
  probe.StepAt(0, 40, 2);
  probe.qpos()[at.joint_qpos[6]] = 2.4;  // the sound knee, beyond its limit
  probe.StepAt(0, 40, 2);
  const auto pain = probe.details().pain_by_joint;
  double sum = 0;
  for (const double joint : pain) sum += joint / kPainJoints;
  EXPECT_NEAR(sum, probe.walk().pain_sum, 1e-12);
  EXPECT_STREQ(LocomotionDetails::kPainJoints[6].data(), "knee_angle_l");
  EXPECT_GT(pain[6], 0.01);
  EXPECT_GT(pain[6], 10 * pain[0]);
}

TEST(LocomotionDetails, NothingIsThereBeforeTheFirstStepNorAfterAReset) {
  Probe probe("paper", "flat");
  EXPECT_FALSE(probe.environment().details().has_value());
  probe.StepAt(0, 40);
  EXPECT_TRUE(probe.environment().details().has_value());
  probe.environment().Reset(1);
  EXPECT_FALSE(probe.environment().details().has_value());
  probe.environment().Step(ConstantAction(0));
  const LocomotionDetails fresh = probe.details();
  for (const JointRange& range : fresh.joint_ranges) EXPECT_EQ(range.low, range.high);
  EXPECT_LT(std::abs(fresh.speed_mean), 3);
}

TEST(LocomotionDetails, RangesHoldTheAnglesOfTheStepsAndTheModelsLimits) {
  Probe probe("paper", "flat");
  const LocomotionIndices& at = probe.environment().indices();
  probe.StepAt(0, 40, 2);
  const double first = probe.environment().data().qpos[at.knee_qpos];
  probe.qpos()[at.knee_qpos] = 1;
  probe.StepAt(0, 40, 2);
  const double second = probe.environment().data().qpos[at.knee_qpos];
  ASSERT_STREQ(LocomotionDetails::kJoints[12].data(), "osl_knee_angle_r");
  const JointRange knee = probe.details().joint_ranges[12];
  EXPECT_EQ(knee.low, std::min(first, second));
  EXPECT_EQ(knee.high, std::max(first, second));
  EXPECT_GT(knee.high - knee.low, 0.5);
  EXPECT_NEAR(knee.limit_low, 0, 1e-9);
  EXPECT_NEAR(knee.limit_high, 120 * std::numbers::pi / 180, 1e-3);
  const JointRange ankle = probe.details().joint_ranges[13];
  EXPECT_NEAR(ankle.limit_low, -30 * std::numbers::pi / 180, 1e-3);
  for (const JointRange& range : probe.details().joint_ranges) {
    EXPECT_LT(range.limit_low, range.limit_high);
  }
}

TEST(LocomotionDetails, SpeedIsTheWayByTheTimeOfTheSteps) {
  Probe probe("paper", "flat");
  probe.StepAt(0, 50);  // from y = 55 in a step of 5 ms
  EXPECT_NEAR(probe.details().speed_mean, 1000, 2);
  EXPECT_FALSE(probe.details().fall_time.has_value());
}

TEST(LocomotionDetails, TellWhenAndWhereOneFell) {
  Probe probe("paper", "flat");
  ASSERT_TRUE(probe.StepAt(0, 40, 0, 1.3).ended);
  ASSERT_EQ(probe.facts().end, LocomotionEnd::kFell);
  EXPECT_EQ(probe.details().fall_time, probe.facts().sim_time);
  EXPECT_EQ(probe.details().fall_y, probe.walk().final_y);
  Probe off("paper", "flat");
  ASSERT_TRUE(off.StepAt(1.6, 40).ended);
  EXPECT_FALSE(off.details().fall_time.has_value());
  EXPECT_FALSE(off.details().fall_y.has_value());
}

TEST(LocomotionDetails, ObstaclesCountOnceTheyAreWhollyPassed) {
  Probe probe("paper", "stairs");
  probe.StepAt(0, 55 - 29.5, 1);
  EXPECT_EQ(probe.details().obstacle_heights[2], std::nullopt);
  probe.StepAt(0, 55 - 40.3, 1);
  EXPECT_NEAR(probe.details().obstacle_heights[2].value(), 2.0 / 8 * 0.5, 1e-6);
  probe.StepAt(0, 55 - 20, 1);  // back again: it was passed
  EXPECT_NEAR(probe.details().obstacle_heights[2].value(), 2.0 / 8 * 0.5, 1e-6);
  EXPECT_EQ(probe.details().obstacle_heights[0], std::nullopt);
  EXPECT_EQ(probe.details().obstacle_heights[1], std::nullopt);
}

}  // namespace
}  // namespace myograde::sim
