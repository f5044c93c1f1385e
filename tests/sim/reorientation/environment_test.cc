// Episodes of die reorientation: what is drawn, actions, observations, ends, and each switch of the
// rules.
#include "sim/reorientation/environment.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/lease/lease.h"
#include "protocol/lease/sim_channel.h"
#include "protocol/tracks/reorientation/track.h"
#include "tests/sim/reorientation/helpers.h"

namespace myograde::sim {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kPositionError = 51, kRotation = 54, kRotationError = 60;  // in the observation

const std::vector<double>& Rest() {
  static const std::vector<double> rest(39, -1.0);
  return rest;
}

// The goal is where and how the die lies in the model's own state.
ReorientationRules EasyRules() {
  ReorientationRules rules = DieRules();
  rules.goal_position_m = rules.goal_rotation_rad = {0, 0};
  return rules;
}

std::vector<double> StateAfterWaves(ReorientationEnvironment& env, uint64_t seed) {
  env.Reset(seed);
  std::vector<double> action(39);
  for (int t = 0; t < 20; ++t) {
    for (int i = 0; i < 39; ++i) action[static_cast<size_t>(i)] = std::sin(0.2 * t + i);
    env.Step(action);
  }
  return {env.state().begin(), env.state().end()};
}

TEST(ReorientationEnvironment, TheSameSeedGivesTheSameEpisodeBitForBit) {
  const auto one = MakeDie();
  const auto two = MakeDie();
  const std::vector<double> first = StateAfterWaves(*one, 7);
  EXPECT_EQ(first, StateAfterWaves(*two, 7));
  EXPECT_NE(first, StateAfterWaves(*one, 8));
  EXPECT_EQ(first, StateAfterWaves(*one, 7)) << "nothing is left of the episode before";
}

TEST(ReorientationReset, DrawsWithinTheRangesAndStartsOpenAndPalmUp) {
  const auto env = MakeDie();
  double lightest = 1, heaviest = 0, smallest = 1, largest = -1;
  for (uint64_t seed = 0; seed < 200; ++seed) {
    env->Reset(seed);
    const DieVariation& drawn = env->variation();
    const Eigen::Vector3d moved = drawn.goal_position - env->scene().goal_position;
    EXPECT_LE(moved.cwiseAbs().maxCoeff(), 0.02);
    EXPECT_LE(drawn.goal_rotation.cwiseAbs().maxCoeff(), 3.14);
    ASSERT_EQ(drawn.friction.size(), 45);
    EXPECT_GE(*std::ranges::min_element(drawn.friction), 0.00008);
    EXPECT_LE(*std::ranges::max_element(drawn.friction), 1.2);
    lightest = std::min(lightest, drawn.mass), heaviest = std::max(heaviest, drawn.mass);
    smallest = std::min(smallest, drawn.size_change);
    largest = std::max(largest, drawn.size_change);
    EXPECT_EQ(env->data().qpos[0], -1.5);
    EXPECT_EQ(mju_norm(env->data().qpos + 1, 28), 0);
  }
  EXPECT_TRUE(lightest >= 0.05 && lightest < 0.06 && heaviest <= 0.25 && heaviest > 0.24);
  EXPECT_TRUE(smallest >= -0.007 && smallest < -0.006 && largest <= 0.007 && largest > 0.006);
}

TEST(ReorientationReset, SizeChangesEveryShapeOfTheDieButNotItsThickness) {
  const auto env = MakeDie();
  env->Reset(3);
  const double change = env->variation().size_change;
  const int first = env->scene().first_geom;
  const mjtNum* capsule = env->model().geom_size + 3 * first;
  EXPECT_DOUBLE_EQ(capsule[0], 0.005);
  EXPECT_DOUBLE_EQ(capsule[1], 0.0235 + change);
  const mjtNum* box = env->model().geom_size + 3 * (first + 12);
  EXPECT_DOUBLE_EQ(box[0], 0.0284 + change);
  EXPECT_DOUBLE_EQ(box[1], 0.0236 + change);
  const mjtNum* place = env->model().geom_pos + 3 * first;
  EXPECT_NEAR(place[0], 0.0235 + change, 1e-14);
  EXPECT_EQ(place[1], 0);
  EXPECT_NEAR(place[2], -0.0235 - change, 1e-14);
}

TEST(ReorientationReset, InertiaAndBoundsFollowTheSizeUnlessTheyAreFixed) {
  ReorientationRules rules = DieRules();
  const auto fixed = MakeDie(rules);
  rules.inertia_fixed = rules.bounding_radius_fixed = false;
  const auto real = MakeDie(rules);
  fixed->Reset(3), real->Reset(3);
  const int die = fixed->scene().die_body, box = fixed->scene().first_geom + 14;
  const double edge = 0.06 + 2 * real->variation().size_change;
  EXPECT_DOUBLE_EQ(fixed->model().body_inertia[3 * die], 1e-4);
  EXPECT_NEAR(real->model().body_inertia[3 * die], real->variation().mass * edge * edge / 6, 1e-18);
  EXPECT_NE(real->model().body_invweight0[2 * die], fixed->model().body_invweight0[2 * die]);
  EXPECT_DOUBLE_EQ(real->model().geom_rbound[box], mju_norm3(real->model().geom_size + 3 * box));
  EXPECT_NE(fixed->model().geom_rbound[box], real->model().geom_rbound[box]);
  const mjtNum radius = fixed->model().geom_rbound[box];
  fixed->Reset(4);
  EXPECT_EQ(fixed->model().geom_rbound[box], radius);
}

// A large die touches fingers where it starts, partly outside of the boxes of the model's shapes.
TEST(ReorientationContacts, AreLostOutsideOfTheModelsBoxesUnlessTheyFollowTheShapes) {
  ReorientationRules rules = DieRules();
  const auto official = MakeDie(rules);
  rules.search_boxes_fixed = false;
  const auto real = MakeDie(rules);
  official->Reset(2), real->Reset(2);
  ASSERT_GT(official->variation().size_change, 0.005);
  EXPECT_GT(official->data().ncon, 0);
  EXPECT_GT(real->data().ncon, official->data().ncon);
}

TEST(ReorientationActions, FollowTheOfficialCurveAndPassWhatIsOutOfRange) {
  const auto env = MakeDie();
  env->Reset(0);
  std::vector<double> action = Rest();
  action[1] = 0.5, action[2] = 3;
  env->Step(action);
  EXPECT_DOUBLE_EQ(env->data().ctrl[0], 1 / (1 + std::exp(7.5)));
  EXPECT_DOUBLE_EQ(env->data().ctrl[1], 0.5);
  EXPECT_DOUBLE_EQ(env->data().ctrl[2], 1 / (1 + std::exp(-12.5)));
  EXPECT_EQ(env->facts().clipped, 0);
  env->SetConvention(ActionConvention::kDirect);
  env->Step(action);
  EXPECT_EQ(env->data().ctrl[1], 0.5);
  EXPECT_EQ(env->data().ctrl[2], 3);
}

TEST(ReorientationActions, AreClippedAndCountedWhereTheRulesSaySo) {
  ReorientationRules rules = DieRules();
  rules.actions_unclipped = false;
  const auto env = MakeDie(rules);
  env->Reset(0);
  std::vector<double> action(39, 0.0);
  action[0] = -2, action[1] = 1.5;
  env->Step(action);
  EXPECT_DOUBLE_EQ(env->data().ctrl[0], 1 / (1 + std::exp(7.5)));
  EXPECT_DOUBLE_EQ(env->data().ctrl[1], 1 / (1 + std::exp(-2.5)));
  EXPECT_EQ(env->facts().clipped, 2);
  env->SetConvention(ActionConvention::kDirect);
  env->Step(action);
  EXPECT_EQ(env->data().ctrl[0], 0);
  EXPECT_EQ(env->facts().clipped, 4);
}

TEST(ReorientationObservation, LeavesOutTheLastJointAndScalesVelocities) {
  ReorientationRules rules = DieRules();
  const auto official = MakeDie(rules);
  rules.velocities_times_step = false;
  const auto plain = MakeDie(rules);
  StateAfterWaves(*official, 1), StateAfterWaves(*plain, 1);
  const std::vector<double> seen = Observed(*official);
  for (size_t i = 0; i < 22; ++i) EXPECT_EQ(seen[i], official->data().qpos[i]);
  for (size_t i = 0; i < 23; ++i) {
    EXPECT_EQ(Observed(*plain)[22 + i], plain->data().qvel[i]);
    EXPECT_DOUBLE_EQ(seen[22 + i], 0.01 * official->data().qvel[i]);
  }
  std::vector<double> extra(24);
  official->ObserveExtra(extra);
  EXPECT_EQ(extra[0], official->data().time);
  EXPECT_EQ(extra[23], official->data().qpos[22]);
}

TEST(ReorientationObservation, AnglesAreTheShorterWayRoundWhereTheRulesSaySo) {
  ReorientationRules rules = EasyRules();
  rules.goal_rotation_rad = {-3, -3};
  const auto official = MakeDie(rules);
  rules.rotation_error_unwrapped = false;
  const auto wrapped = MakeDie(rules);
  for (auto* env : {official.get(), wrapped.get()}) {
    env->Reset(0);
    env->data().qpos[26] = 3;  // the die's first hinge
    env->SynchroniseState();
    EXPECT_NEAR(Observed(*env)[kRotation], 3, 1e-9);
  }
  // Roll, pitch and yaw of (-3, -3, -3) are (pi - 3, 3 - pi, pi - 3).
  const double roll = Observed(*official)[kRotationError];
  EXPECT_NEAR(roll, kPi - 6, 1e-9);
  EXPECT_NEAR(Observed(*wrapped)[kRotationError], roll, 1e-9) << "not more than half a turn";
  for (auto* env : {official.get(), wrapped.get()}) {
    env->data().qpos[26] = 0;
    env->data().qpos[28] = -3.1;  // the last: yaw
    env->SynchroniseState();
  }
  EXPECT_NEAR(Observed(*official)[kRotationError + 2], kPi - 3 + 3.1, 1e-9);
  EXPECT_NEAR(Observed(*wrapped)[kRotationError + 2], 0.1 - kPi, 1e-9);
}

TEST(ReorientationEnd, ADieThatIsTooFarAwayIsDropped) {
  const auto env = MakeDie();
  env->Reset(2);
  EXPECT_FALSE(env->Step(Rest()).ended);
  EXPECT_EQ(Rewards(*env).at(7), 0);
  env->data().qpos[24] = 0.24;  // along y, where nothing is
  env->SynchroniseState();
  EXPECT_TRUE(env->Step(Rest()).ended);
  EXPECT_EQ(env->facts().end, ReorientationEnd::kDropped);
  EXPECT_EQ(Rewards(*env).at(4), -1);
  EXPECT_EQ(Rewards(*env).at(7), 1);
  EXPECT_GT(FactsOf(*env).final_position_error, 0.2);
}

TEST(ReorientationEnd, ASecondAndAHalfIsOverAfter150Steps) {
  ReorientationRules rules = DieRules();
  rules.drop_distance_m = 10;
  const auto env = MakeDie(rules);
  env->Reset(2);
  for (int t = 1; t < 150; ++t) ASSERT_FALSE(env->Step(Rest()).ended) << t;
  EXPECT_TRUE(env->Step(Rest()).ended);
  EXPECT_EQ(env->facts().end, EpisodeEnd::kTime);
  EXPECT_EQ(env->facts().steps, 150);
  EXPECT_NEAR(env->facts().sim_time, 1.5, 1e-12);
}

TEST(ReorientationFacts, CountStepsWithTheFlagAndSumUpEffort) {
  const auto env = MakeDie(EasyRules());
  env->Reset(2);
  EXPECT_FALSE(env->details().has_value());
  EXPECT_NEAR(FactsOf(*env).final_position_error, 0, 1e-12);
  int64_t solved = 0;
  double effort = 0, smallest = 10;
  for (int t = 0; t < 60; ++t) {
    env->Step(std::vector<double>(39, 0.3));
    const std::vector<double> terms = Rewards(*env);
    solved += terms[6] == 1;
    effort -= terms[3];
    smallest = std::min(smallest, -terms[1]);
    EXPECT_EQ(FactsOf(*env).solved, terms[6] == 1);
    EXPECT_EQ(FactsOf(*env).final_position_error, -terms[0]);
    EXPECT_EQ(terms[5], terms[1] + 10 * terms[0]);
    EXPECT_EQ(terms[2], (-terms[0] < 0.05) + (-terms[0] < 0.025));
    const Eigen::Vector3d error = Eigen::Vector3d::Map(Observed(*env).data() + kPositionError);
    EXPECT_DOUBLE_EQ(error.norm(), -terms[0]);
  }
  EXPECT_GT(solved, 0);
  EXPECT_LT(solved, 60) << "the hand closes and the die turns away";
  EXPECT_EQ(FactsOf(*env).solved_steps, solved);
  EXPECT_NEAR(FactsOf(*env).effort_sum, effort, 1e-12);
  EXPECT_EQ(FactsOf(*env).smallest_rotation_error, smallest);
  const auto details = std::get<ReorientationDetails>(env->details().value());
  EXPECT_EQ(details.solved_time, 0.01);
  EXPECT_GT(details.joint_ranges[9].high, 0.3) << "a finger bends";
  EXPECT_DOUBLE_EQ(details.joint_ranges[9].limit_high, 1.5708);
}

TEST(ReorientationFaults, BadNumbersAreUnstableOrResetTheOfficialSimulation) {
  ReorientationRules rules = DieRules();
  const auto official = MakeDie(rules);
  rules.warnings_reset_simulation = false;
  const auto strict = MakeDie(rules);
  for (auto* env : {official.get(), strict.get()}) {
    env->Reset(0);
    env->Step(Rest());
    env->data().qvel[0] = 1e12;
  }
  EXPECT_TRUE(strict->Step(Rest()).unstable);
  EXPECT_FALSE(official->Step(Rest()).unstable);
  EXPECT_EQ(official->data().time, 0);
  EXPECT_EQ(official->data().qpos[0], 0) << "back to the model's start, as the official code does";
}

TEST(ReorientationLayout, NamesWhatTheModelHasInItsOrder) {
  const TrackLayout& layout = ReorientationTrack().layout();
  const auto env = MakeDie();
  ASSERT_EQ(layout.observation.size(), env->observation_size());
  ASSERT_EQ(layout.action.size(), env->action_size());
  EXPECT_EQ(layout.direct_bounds.size(), 39);
  EXPECT_DOUBLE_EQ(ReorientationTrack().control_period_s,
                   ReorientationEnvironment::kPhysicsSteps * env->model().opt.timestep);
  for (int i = 0; i < 39; ++i) {
    const std::string muscle = mj_id2name(&env->model(), mjOBJ_ACTUATOR, i);
    EXPECT_EQ(layout.action.names()[static_cast<size_t>(i)], "muscles." + muscle);
  }
  for (int i = 0; i < 23; ++i) {
    const std::string joint = mj_id2name(&env->model(), mjOBJ_JOINT, i);
    EXPECT_EQ(layout.extra.names()[static_cast<size_t>(i) + 1], "hand_qpos." + joint);
    EXPECT_DOUBLE_EQ(layout.extra.bounds()[static_cast<size_t>(i) + 1].high,
                     env->model().jnt_range[2 * i + 1]);
  }
}

TEST(ReorientationFacts, SurviveTheirJson) {
  EpisodeFacts facts;
  facts.end = ReorientationEnd::kDropped;
  auto& die = facts.track.emplace<ReorientationFacts>();
  double next = 0.5;
  ReorientationFacts::Visit(die, [&](const char*, auto& value) {
    value = static_cast<std::remove_reference_t<decltype(value)>>(next++);
  });
  const auto back = EpisodeFactsFromJson(EpisodeFactsToJson(facts));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(EpisodeFactsToJson(*back), EpisodeFactsToJson(facts));
  EXPECT_EQ(std::get<ReorientationFacts>(back->track).effort_sum, 5.5);
}

}  // namespace
}  // namespace myograde::sim
