// Episodes of Baoding balls: what is drawn, observations, ends, facts, and each switch of the
// rules.
#include "sim/baoding/environment.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/lease/lease.h"
#include "protocol/lease/sim_channel.h"
#include "protocol/tracks/baoding/track.h"
#include "tests/sim/baoding/helpers.h"

namespace myograde::sim {
namespace {

using Eigen::Vector3d;

constexpr double kPi = std::numbers::pi;
constexpr int kBall = 23, kSpeed = 26, kTarget = 35, kError = 41;  // in the observation

const std::vector<double>& Rest() {
  static const std::vector<double> rest(39, -1.0);
  return rest;
}

// Keeps the balls in the hollow of the hand, of seed 2 for the whole episode
// (tests/differential/record_baoding.py).
std::vector<double> Cup() {
  std::vector<double> action = Rest();
  std::fill_n(action.begin(), 3, 0.3);
  std::fill_n(action.begin() + 3, 3, -0.4);
  std::fill_n(action.begin() + 6, 2, -0.2);
  std::fill_n(action.begin() + 8, 4, -0.3);
  std::fill_n(action.begin() + 12, 4, -0.9);
  action[24] = action[26] = 0.15;
  std::fill(action.begin() + 27, action.end(), 1.0);
  return action;
}

Vector3d Seen(const BaodingEnvironment& env, int at) {
  return Vector3d::Map(Observed(env).data() + at);
}

// A target's place on its ellipse in the palm's frame, as an angle.
double AngleOf(BaodingEnvironment& env, size_t ball) {
  const TargetPath& path = env.variation().path;
  const mjtNum* place = env.model().site_pos + 3 * env.scene().target_sites[ball];
  return std::atan2((place[1] + 0.07) / path.y_radius, (place[0] + 0.0125) / path.x_radius);
}

double Apart(double a, double b) { return std::abs(std::remainder(a - b, 2 * kPi)); }

std::vector<double> StateAfterWaves(BaodingEnvironment& env, uint64_t seed) {
  env.Reset(seed);
  std::vector<double> action(39);
  for (int t = 0; t < 10; ++t) {
    for (int i = 0; i < 39; ++i) action[static_cast<size_t>(i)] = std::sin(0.2 * t + i);
    env.Step(action);
  }
  std::vector<double> all(env.state().begin(), env.state().end());
  const std::vector<double> seen = Observed(env);
  all.insert(all.end(), seen.begin(), seen.end());
  return all;
}

TEST(BaodingEnvironment, TheSameSeedGivesTheSameEpisodeBitForBit) {
  const auto one = MakeBalls();
  const auto two = MakeBalls();
  const std::vector<double> first = StateAfterWaves(*one, 7);
  EXPECT_EQ(first, StateAfterWaves(*two, 7));
  EXPECT_NE(first, StateAfterWaves(*one, 8));
  one->Reset(7);
  two->Reset(7);
  EXPECT_EQ(Observed(*one), Observed(*two)) << "nothing is left of the episode before";
  EXPECT_EQ(first, StateAfterWaves(*one, 7));
}

TEST(BaodingReset, DrawsWithinTheRangesAndStartsOpenAndPalmUp) {
  const auto env = MakeBalls();
  std::multiset<int> directions;
  double slowest = 0, fastest = 10, lightest = 1, heaviest = 0, smallest = 1, largest = 0;
  for (uint64_t seed = 0; seed < 300; ++seed) {
    env->Reset(seed);
    const BallVariation& drawn = env->variation();
    directions.insert(drawn.path.direction);
    EXPECT_EQ(FactsOf(*env).direction, drawn.path.direction);
    EXPECT_TRUE(drawn.path.start_angle >= 0 && drawn.path.start_angle < 2 * kPi);
    EXPECT_TRUE(drawn.path.x_radius >= 0.02 && drawn.path.x_radius < 0.03);
    EXPECT_TRUE(drawn.path.y_radius >= 0.022 && drawn.path.y_radius < 0.032);
    slowest = std::max(slowest, drawn.path.period);
    fastest = std::min(fastest, drawn.path.period);
    for (size_t i = 0; i < 2; ++i) {
      lightest = std::min(lightest, drawn.masses[i]);
      heaviest = std::max(heaviest, drawn.masses[i]);
      smallest = std::min(smallest, drawn.sizes[i]);
      largest = std::max(largest, drawn.sizes[i]);
      const Vector3d change = (drawn.frictions[i] - Vector3d(1, 0.005, 0.0001)).cwiseAbs();
      EXPECT_TRUE((change.array() <= Eigen::Array3d(0.2, 0.001, 0.00002)).all());
    }
    EXPECT_EQ(env->data().qpos[0], -1.57);
    EXPECT_EQ(mju_norm(env->data().qpos + 1, 22), 0);
    EXPECT_EQ(mju_norm(env->data().qvel, 35), 0);
  }
  for (const int direction : {-1, 0, 1}) EXPECT_GT(directions.count(direction), 70);
  EXPECT_TRUE(fastest >= 4 && fastest < 4.1 && slowest < 6 && slowest > 5.9);
  EXPECT_TRUE(lightest >= 0.03 && lightest < 0.035 && heaviest < 0.3 && heaviest > 0.295);
  EXPECT_TRUE(smallest >= 0.018 && smallest < 0.0182 && largest < 0.024 && largest > 0.0238);
}

TEST(BaodingReset, InertiaAndBoundsFollowTheBallsUnlessTheyAreFixed) {
  BaodingRules rules = BallsRules();
  const auto fixed = MakeBalls(rules);
  rules.inertia_fixed = rules.bounding_radius_fixed = false;
  const auto real = MakeBalls(rules);
  fixed->Reset(3), real->Reset(3);
  for (size_t i = 0; i < 2; ++i) {
    const int ball = fixed->scene().bodies[i], geom = fixed->scene().geoms[i];
    const double size = real->variation().sizes[i];
    EXPECT_EQ(fixed->model().geom_size[3 * geom], size);
    EXPECT_DOUBLE_EQ(fixed->model().body_inertia[3 * ball], 1e-4);
    EXPECT_DOUBLE_EQ(fixed->model().geom_rbound[geom], 0.022);
    EXPECT_DOUBLE_EQ(real->model().body_inertia[3 * ball],
                     0.4 * real->variation().masses[i] * size * size);
    EXPECT_EQ(real->model().geom_rbound[geom], size);
    EXPECT_NE(real->model().body_invweight0[2 * ball], fixed->model().body_invweight0[2 * ball]);
  }
}

TEST(BaodingContacts, AreLostOutsideOfTheModelsBoxesUnlessTheyFollowTheBalls) {
  BaodingRules rules = BallsRules();
  const auto official = MakeBalls(rules);
  rules.search_boxes_fixed = false;
  const auto real = MakeBalls(rules);
  const auto differ = [&](uint64_t seed) {
    official->Reset(seed), real->Reset(seed);
    for (int t = 0; t < 10; ++t) {
      official->Step(Rest()), real->Step(Rest());
      if (official->data().ncon != real->data().ncon) return true;
    }
    return false;
  };
  int differing = 0;
  for (uint64_t seed = 0; seed < 10; ++seed) differing += differ(seed);
  EXPECT_GT(differing, 0);
  EXPECT_LT(differing, 10) << "small balls are within the boxes";
}

TEST(BaodingTargets, AreOneStepLateAndFirstThoseOfTheConstructor) {
  const auto env = MakeBalls();
  Vector3d first;
  for (const uint64_t seed : {1, 2, 3}) {
    env->Reset(seed);
    if (seed == 1) first = Seen(*env, kTarget);
    EXPECT_EQ(Seen(*env, kTarget), first) << "whatever was drawn";
    const TargetPath& path = env->variation().path;
    for (int t = 0; t < 3; ++t) {
      env->Step(Rest());
      const double turn = path.direction * 2 * kPi * 0.025 * t / path.period;
      EXPECT_LT(Apart(AngleOf(*env, 0), path.start_angle + turn), 1e-12);
      EXPECT_LT(Apart(AngleOf(*env, 1), path.start_angle + turn + kPi), 1e-12);
    }
  }
}

TEST(BaodingTargets, AreThoseOfTheTimeWhereTheRulesSaySo) {
  BaodingRules rules = BallsRules();
  rules.targets_late = false;
  const auto env = MakeBalls(rules);
  for (const uint64_t seed : {1, 2, 3}) {
    env->Reset(seed);
    const TargetPath& path = env->variation().path;
    for (int t = 0; t < 3; ++t) {
      const double turn = path.direction * 2 * kPi * env->data().time / path.period;
      EXPECT_LT(Apart(AngleOf(*env, 0), path.start_angle + turn), 1e-12);
      env->Step(Rest());
    }
  }
}

TEST(BaodingTargets, AreShownByBodiesThatPicturesHave) {
  const auto env = MakeBalls();
  env->Reset(4);
  for (int t = 0; t < 2; ++t, env->Step(Rest())) {
    for (size_t i = 0; i < 2; ++i) {
      const Vector3d target = Seen(*env, kTarget + 3 * static_cast<int>(i));
      const int body = env->scene().target_bodies[i];
      const mjData& data = env->data();
      EXPECT_EQ(Vector3d(Vector3d::Map(data.xpos + 3 * body)), target);
      EXPECT_EQ(Vector3d(Vector3d::Map(data.geom_xpos + 3 * env->model().body_geomadr[body])),
                target);
      EXPECT_EQ(Vector3d(Vector3d::Map(data.mocap_pos + 3 * i)), target);
    }
  }
}

TEST(BaodingActions, ArePassedOutOfRangeOrClippedAndCounted) {
  BaodingRules rules = BallsRules();
  const auto official = MakeBalls(rules);
  rules.actions_unclipped = false;
  const auto clipped = MakeBalls(rules);
  std::vector<double> action = Rest();
  action[2] = 3;
  official->Reset(0), clipped->Reset(0);
  official->Step(action), clipped->Step(action);
  EXPECT_DOUBLE_EQ(official->data().ctrl[2], 1 / (1 + std::exp(-12.5)));
  EXPECT_DOUBLE_EQ(clipped->data().ctrl[2], 1 / (1 + std::exp(-2.5)));
  EXPECT_EQ(official->facts().clipped, 0);
  EXPECT_EQ(clipped->facts().clipped, 1);
}

TEST(BaodingObservation, HasBallsTargetsAndScaledVelocities) {
  BaodingRules rules = BallsRules();
  const auto official = MakeBalls(rules);
  rules.velocities_times_step = false;
  const auto plain = MakeBalls(rules);
  StateAfterWaves(*official, 1), StateAfterWaves(*plain, 1);
  const std::vector<double> seen = Observed(*official);
  for (size_t i = 0; i < 23; ++i) EXPECT_EQ(seen[i], official->data().qpos[i]);
  for (const int ball : {0, 1}) {
    const Vector3d place = Seen(*official, kBall + 6 * ball);
    EXPECT_LT((place - Vector3d::Map(official->data().qpos + 23 + 7 * ball)).norm(), 1e-15);
    EXPECT_EQ(Seen(*official, kError + 3 * ball), Seen(*official, kTarget + 3 * ball) - place);
    const Vector3d speed = Vector3d::Map(plain->data().qvel + 23 + 6 * ball);
    EXPECT_EQ(Seen(*plain, kSpeed + 6 * ball), speed);
    EXPECT_LT((Seen(*official, kSpeed + 6 * ball) - 0.025 * speed).norm(), 1e-15);
  }
  std::vector<double> extra(1);
  official->ObserveExtra(extra);
  EXPECT_EQ(extra[0], official->data().time);
}

TEST(BaodingEnd, ABallBelowTheHandIsDropped) {
  for (const int ball : {0, 1}) {
    const auto env = MakeBalls();
    env->Reset(2);
    EXPECT_FALSE(env->Step(Rest()).ended);
    EXPECT_EQ(Rewards(*env).at(5), 0);
    env->data().qpos[23 + 7 * ball + 2] = 1.24;
    env->SynchroniseState();
    EXPECT_TRUE(env->Step(Rest()).ended);
    EXPECT_EQ(env->facts().end, BaodingEnd::kDropped);
    EXPECT_EQ(Rewards(*env).at(5), 1);
  }
}

TEST(BaodingEnd, FiveSecondsAreOverAfter200Steps) {
  const auto env = MakeBalls();
  env->Reset(2);
  for (int t = 1; t < 200; ++t) ASSERT_FALSE(env->Step(Cup()).ended) << t;
  EXPECT_TRUE(env->Step(Cup()).ended);
  EXPECT_EQ(env->facts().end, EpisodeEnd::kTime);
  EXPECT_EQ(env->facts().steps, 200);
  EXPECT_NEAR(env->facts().sim_time, 5, 1e-12);
}

TEST(BaodingFacts, CountStepsWithTheFlagAndSumUpDistanceAndEffort) {
  BaodingRules rules = BallsRules();
  rules.position_tolerance_m = 0.035;
  const auto env = MakeBalls(rules);
  env->Reset(2);
  EXPECT_FALSE(env->details().has_value());
  int64_t solved = 0;
  double effort = 0, distance = 0;
  std::optional<double> first;
  for (int t = 0; t < 100; ++t) {
    env->Step(Cup());
    const std::vector<double> terms = Rewards(*env);
    const double away[] = {Seen(*env, kError).norm(), Seen(*env, kError + 3).norm()};
    EXPECT_EQ(terms[0], -away[0]);
    EXPECT_EQ(terms[1], -away[1]);
    EXPECT_EQ(terms[3], -(away[0] + away[1]));
    EXPECT_EQ(terms[4], std::max(away[0], away[1]) < 0.035);
    if (terms[4] == 1 && !first) first = env->data().time;
    EXPECT_EQ(FactsOf(*env).solved, terms[4] == 1);
    solved += terms[4] == 1;
    distance += (away[0] + away[1]) / 2;
    effort -= terms[2];
  }
  EXPECT_GT(solved, 0);
  EXPECT_LT(solved, 100) << "the balls lie while the targets turn";
  EXPECT_EQ(FactsOf(*env).solved_steps, solved);
  EXPECT_NEAR(FactsOf(*env).distance_sum, distance, 1e-12);
  EXPECT_NEAR(FactsOf(*env).effort_sum, effort, 1e-12);
  const auto details = std::get<BaodingDetails>(env->details().value());
  EXPECT_EQ(details.solved_time, first);
  EXPECT_GT(details.joint_ranges[11].high, 0.3) << "a finger bends";
  EXPECT_DOUBLE_EQ(details.joint_ranges[11].limit_high, 1.5708);
}

TEST(BaodingFaults, BadNumbersAreUnstableOrResetTheOfficialSimulation) {
  BaodingRules rules = BallsRules();
  const auto official = MakeBalls(rules);
  rules.warnings_reset_simulation = false;
  const auto strict = MakeBalls(rules);
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

TEST(BaodingLayout, NamesWhatTheModelHasInItsOrder) {
  const TrackLayout& layout = BaodingTrack().layout();
  const auto env = MakeBalls();
  ASSERT_EQ(layout.observation.size(), env->observation_size());
  ASSERT_EQ(layout.action.size(), env->action_size());
  ASSERT_EQ(layout.extra.size(), 1);
  EXPECT_DOUBLE_EQ(BaodingTrack().control_period_s,
                   BaodingEnvironment::kPhysicsSteps * env->model().opt.timestep);
  for (int i = 0; i < 39; ++i) {
    const std::string muscle = mj_id2name(&env->model(), mjOBJ_ACTUATOR, i);
    EXPECT_EQ(layout.action.names()[static_cast<size_t>(i)], "muscles." + muscle);
  }
  for (int i = 0; i < 23; ++i) {
    const std::string joint = mj_id2name(&env->model(), mjOBJ_JOINT, i);
    EXPECT_EQ(layout.observation.names()[static_cast<size_t>(i)], "hand_pos." + joint);
  }
}

TEST(BaodingFacts, SurviveTheirJson) {
  EpisodeFacts facts;
  facts.end = BaodingEnd::kDropped;
  auto& balls = facts.track.emplace<BaodingFacts>();
  double next = 0.5;
  BaodingFacts::Visit(balls, [&](const char*, auto& value) {
    value = static_cast<std::remove_reference_t<decltype(value)>>(next++);
  });
  const auto back = EpisodeFactsFromJson(EpisodeFactsToJson(facts));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(EpisodeFactsToJson(*back), EpisodeFactsToJson(facts));
  EXPECT_EQ(std::get<BaodingFacts>(back->track).effort_sum, 4.5);
}

}  // namespace
}  // namespace myograde::sim
