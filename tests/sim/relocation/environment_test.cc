// Episodes of relocation: what is drawn, resets that draw again, observations, ends, and each
// switch of the rules.
#include "sim/relocation/environment.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "protocol/lease/lease.h"
#include "protocol/lease/sim_channel.h"
#include "protocol/tracks/relocation/track.h"
#include "tests/sim/relocation/helpers.h"

namespace myograde::sim {
namespace {

using Eigen::Vector3d;

constexpr int kObject = 75, kRotationError = 90;  // in the observation
constexpr uint64_t kOnce = 0, kTwice = 1;         // seeds whose reset draws once and twice

const std::vector<double>& Rest() {
  static const std::vector<double> rest(63, -1.0);
  return rest;
}

std::vector<double> StateAfterWaves(RelocationEnvironment& env, uint64_t seed) {
  env.Reset(seed);
  std::vector<double> action(63);
  for (int t = 0; t < 20; ++t) {
    for (int i = 0; i < 63; ++i) action[static_cast<size_t>(i)] = std::sin(0.2 * t + i);
    env.Step(action);
  }
  return {env.state().begin(), env.state().end()};
}

TEST(RelocationEnvironment, TheSameSeedGivesTheSameEpisodeBitForBit) {
  const auto one = MakeObject();
  const auto two = MakeObject();
  const std::vector<double> first = StateAfterWaves(*one, 7);
  EXPECT_EQ(first, StateAfterWaves(*two, 7));
  EXPECT_NE(first, StateAfterWaves(*one, 8));
  EXPECT_EQ(first, StateAfterWaves(*one, 7)) << "nothing is left of the episode before";
}

TEST(RelocationReset, DrawsWithinTheRangesUntilNothingTouches) {
  const auto env = MakeObject();
  const RelocationRules rules = ObjectRules();
  std::set<int> types;
  const auto within = [](const Vector3d& low, const Vector3d& number, const Vector3d& high) {
    return (number.array() >= low.array()).all() && (number.array() <= high.array()).all();
  };
  int again = 0;
  for (uint64_t seed = 0; seed < 40; ++seed) {
    env->Reset(seed);
    again += env->draws() > 1;
    EXPECT_EQ(env->data().ncon, 0);
    const RelocationVariation& drawn = env->variation();
    EXPECT_TRUE(within(rules.goal_low_m, drawn.goal_position, rules.goal_high_m));
    EXPECT_TRUE(within(rules.object_low_m, drawn.object_position, rules.object_high_m));
    EXPECT_LE(drawn.goal_rotation.cwiseAbs().maxCoeff(), 0.3);
    EXPECT_TRUE(drawn.mass >= 0.05 && drawn.mass <= 0.3);
    for (const RelocationVariation::Shape& shape : drawn.shapes) {
      types.insert(shape.type);
      EXPECT_TRUE(within(rules.half_size_low_m, shape.half_size, rules.half_size_high_m));
      EXPECT_TRUE(within(-shape.half_size, shape.position, shape.half_size));
      EXPECT_TRUE(within(rules.friction_low, shape.friction, rules.friction_high));
      EXPECT_EQ(shape.colour[3], 1);
    }
  }
  EXPECT_EQ(again, 16) << "as often as in the official environment";
  EXPECT_EQ(types, (std::set<int>{mjGEOM_SPHERE, mjGEOM_CAPSULE, mjGEOM_ELLIPSOID, mjGEOM_CYLINDER,
                                  mjGEOM_BOX}));
}

TEST(RelocationReset, StopsDrawingWhereSomethingAlwaysTouches) {
  RelocationRules rules = ObjectRules();
  rules.object_low_m = rules.object_high_m = {0, -0.3, 0.87};  // in the table
  const auto env = MakeObject(rules);
  env->Reset(kOnce);
  EXPECT_EQ(env->draws(), RelocationEnvironment::kMostDraws);
  EXPECT_GT(env->data().ncon, 0);
}

TEST(RelocationReset, TheArmStartsTheSameShareOfEachRangeOff) {
  const auto env = MakeObject();
  for (const uint64_t seed : {kOnce, kTwice}) {
    env->Reset(seed);
    const mjModel& model = env->model();
    for (int i = 0; i < 44; ++i) {
      const double range = model.jnt_range[2 * i + 1] - model.jnt_range[2 * i];
      EXPECT_DOUBLE_EQ(env->data().qpos[i], model.key_qpos[44 + i] + (i < 38 ? 0.015 * range : 0));
    }
  }
}

TEST(RelocationReset, ShowsTheFirstDrawUnlessTheRulesSayOtherwise) {
  RelocationRules rules = ObjectRules();
  const auto official = MakeObject(rules);
  rules.first_observation_of_first_draw = false;
  const auto plain = MakeObject(rules);
  const auto shown = [](const RelocationEnvironment& env) -> Vector3d {
    return Vector3d::Map(Observed(env).data() + kObject);
  };
  const auto real = [](const RelocationEnvironment& env) -> Vector3d {
    return Vector3d::Map(env.data().site_xpos + 3 * env.scene().object_site);
  };
  for (const uint64_t seed : {kOnce, kTwice}) {
    official->Reset(seed), plain->Reset(seed);
    EXPECT_EQ(official->draws(), seed == kOnce ? 1 : 2);
    EXPECT_EQ(shown(*plain), real(*plain));
    EXPECT_EQ(real(*official), real(*plain));
    EXPECT_EQ(shown(*official) == real(*official), seed == kOnce);
    official->Step(Rest());
    EXPECT_EQ(shown(*official), real(*official));
  }
}

TEST(RelocationReset, InertiaFollowsTheMassUnlessItIsFixed) {
  RelocationRules rules = ObjectRules();
  const auto fixed = MakeObject(rules);
  rules.inertia_fixed = false;
  const auto real = MakeObject(rules);
  fixed->Reset(3), real->Reset(3);
  const int body = fixed->scene().object_body;
  const mjtNum* kept = fixed->model().body_inertia + 3 * body;
  EXPECT_EQ(Vector3d::Map(kept), fixed->scene().inertia);
  EXPECT_DOUBLE_EQ(real->model().body_inertia[3 * body],
                   kept[0] * real->variation().mass / real->scene().mass);
  EXPECT_NE(real->model().body_invweight0[2 * body], fixed->model().body_invweight0[2 * body]);
}

// Where the object is searched for within the boxes of the model's cubes, it sinks into the table
// until they touch it.
TEST(RelocationContacts, AreLostOutsideOfTheModelsBoxesUnlessTheyFollowTheShapes) {
  RelocationRules rules = ObjectRules();
  const auto official = MakeObject(rules);
  rules.search_boxes_fixed = false;
  const auto real = MakeObject(rules);
  const auto deepest = [](RelocationEnvironment& env) {
    env.Reset(kOnce);
    double depth = 0;
    for (int t = 0; t < 12; ++t) {
      env.Step(Rest());
      for (int i = 0; i < env.data().ncon; ++i) {
        depth = std::max(depth, -env.data().contact[i].dist);
      }
    }
    return depth;
  };
  EXPECT_GT(deepest(*official), 0.02);
  EXPECT_LT(deepest(*real), 0.01);
}

TEST(RelocationObservation, LeavesOutTheLastJointAndScalesVelocities) {
  RelocationRules rules = ObjectRules();
  const auto official = MakeObject(rules);
  rules.velocities_times_step = false;
  const auto plain = MakeObject(rules);
  StateAfterWaves(*official, kOnce), StateAfterWaves(*plain, kOnce);
  const std::vector<double> seen = Observed(*official);
  for (size_t i = 0; i < 37; ++i) EXPECT_EQ(seen[i], official->data().qpos[i]);
  for (size_t i = 0; i < 38; ++i) {
    EXPECT_EQ(Observed(*plain)[37 + i], plain->data().qvel[i]);
    EXPECT_DOUBLE_EQ(seen[37 + i], 0.01 * official->data().qvel[i]);
  }
  std::vector<double> extra(63);
  official->ObserveExtra(extra);
  EXPECT_EQ(extra[0], official->data().time);
  EXPECT_EQ(extra[38], official->data().qpos[37]);
  EXPECT_TRUE(std::equal(extra.begin() + 45, extra.end(), seen.begin() + 75));
}

TEST(RelocationObservation, AnglesAreTheShorterWayRoundWhereTheRulesSaySo) {
  RelocationRules rules = ObjectRules();
  rules.goal_rotation_rad = {0.3, 0.3};
  const auto official = MakeObject(rules);
  rules.rotation_error_unwrapped = false;
  const auto wrapped = MakeObject(rules);
  std::vector<double> yaws;
  for (auto* env : {official.get(), wrapped.get()}) {
    env->Reset(kOnce);
    env->data().qpos[43] = -3.1;  // the object's last hinge
    env->SynchroniseState();
    env->Step(Rest());
    yaws.push_back(Observed(*env)[kRotationError + 2]);
  }
  EXPECT_NEAR(yaws[0], 3.4, 0.01);
  EXPECT_NEAR(yaws[1], 3.4 - 2 * M_PI, 0.01);
}

TEST(RelocationEnd, AnObjectTooFarFromThePalmIsDropped) {
  const auto env = MakeObject();
  env->Reset(kOnce);
  EXPECT_FALSE(env->Step(Rest()).ended);
  EXPECT_EQ(Rewards(*env).at(5), 0);
  env->data().qpos[39] = -1;  // along y, away from the arm
  env->SynchroniseState();
  EXPECT_TRUE(env->Step(Rest()).ended);
  EXPECT_EQ(env->facts().end, RelocationEnd::kDropped);
  EXPECT_EQ(Rewards(*env).at(5), 1);
  EXPECT_GT(FactsOf(*env).final_reach, 0.5);
  EXPECT_LT(FactsOf(*env).smallest_reach, 0.5);
}

TEST(RelocationEnd, ASecondAndAHalfIsOverAfter150Steps) {
  const auto env = MakeObject();
  env->Reset(kOnce);
  for (int t = 1; t < 150; ++t) ASSERT_FALSE(env->Step(Rest()).ended) << t;
  EXPECT_TRUE(env->Step(Rest()).ended);
  EXPECT_EQ(env->facts().end, EpisodeEnd::kTime);
  EXPECT_NEAR(env->facts().sim_time, 1.5, 1e-12);
}

TEST(RelocationFacts, CountStepsWithTheFlagAndSumUpEffort) {
  RelocationRules rules = ObjectRules();
  rules.position_tolerance_m = 0.3;
  const auto env = MakeObject(rules);
  env->Reset(kOnce);
  EXPECT_FALSE(env->details().has_value());
  int64_t solved = 0;
  double effort = 0, smallest = 10;
  for (int t = 0; t < 30; ++t) {
    env->Step(std::vector<double>(63, 0.3));
    const std::vector<double> terms = Rewards(*env);
    solved += terms[4] == 1;
    effort -= terms[2];
    smallest = std::min(smallest, -terms[0]);
    EXPECT_EQ(terms[4] == 1, -terms[0] < 0.3);
    EXPECT_EQ(FactsOf(*env).solved, terms[4] == 1);
    EXPECT_EQ(FactsOf(*env).final_position_error, -terms[0]);
    EXPECT_EQ(FactsOf(*env).final_rotation_error, -terms[1]);
    EXPECT_EQ(terms[3], terms[1] + 10 * terms[0]);
  }
  EXPECT_EQ(FactsOf(*env).solved_steps, solved);
  EXPECT_NEAR(FactsOf(*env).effort_sum, effort, 1e-12);
  EXPECT_EQ(FactsOf(*env).smallest_position_error, smallest);
  const auto details = std::get<RelocationDetails>(env->details().value());
  EXPECT_EQ(details.solved_time.has_value(), solved > 0);
  EXPECT_DOUBLE_EQ(details.joint_ranges[15].limit_high, env->model().jnt_range[31]);
}

TEST(RelocationFaults, BadNumbersAreUnstableOrResetTheOfficialSimulation) {
  RelocationRules rules = ObjectRules();
  const auto official = MakeObject(rules);
  rules.warnings_reset_simulation = false;
  const auto strict = MakeObject(rules);
  for (auto* env : {official.get(), strict.get()}) {
    env->Reset(kOnce);
    env->Step(Rest());
    env->data().qvel[0] = 1e12;
  }
  EXPECT_TRUE(strict->Step(Rest()).unstable);
  EXPECT_FALSE(official->Step(Rest()).unstable);
  EXPECT_EQ(official->data().time, 0) << "back to the model's start, as the official code does";
}

TEST(RelocationLayout, NamesWhatTheModelHasInItsOrder) {
  const TrackLayout& layout = RelocationTrack().layout();
  const auto env = MakeObject();
  ASSERT_EQ(layout.observation.size(), env->observation_size());
  ASSERT_EQ(layout.action.size(), env->action_size());
  ASSERT_EQ(layout.extra.size(), 63);
  EXPECT_EQ(layout.direct_bounds.size(), 63);
  EXPECT_DOUBLE_EQ(RelocationTrack().control_period_s,
                   RelocationEnvironment::kPhysicsSteps * env->model().opt.timestep);
  for (int i = 0; i < 63; ++i) {
    const std::string muscle = mj_id2name(&env->model(), mjOBJ_ACTUATOR, i);
    EXPECT_EQ(layout.action.names()[static_cast<size_t>(i)], "muscles." + muscle);
  }
  for (int i = 0; i < 38; ++i) {
    const std::string joint = mj_id2name(&env->model(), mjOBJ_JOINT, i);
    EXPECT_EQ(layout.extra.names()[static_cast<size_t>(i) + 1], "hand_qpos_corrected." + joint);
    EXPECT_NEAR(layout.extra.bounds()[static_cast<size_t>(i) + 1].high,
                env->model().jnt_range[2 * i + 1], 1e-3);
  }
}

TEST(RelocationFacts, SurviveTheirJson) {
  EpisodeFacts facts;
  facts.end = RelocationEnd::kDropped;
  auto& object = facts.track.emplace<RelocationFacts>();
  double next = 0.5;
  RelocationFacts::Visit(object, [&](const char*, auto& value) {
    value = static_cast<std::remove_reference_t<decltype(value)>>(next++);
  });
  const auto back = EpisodeFactsFromJson(EpisodeFactsToJson(facts));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(EpisodeFactsToJson(*back), EpisodeFactsToJson(facts));
  EXPECT_EQ(std::get<RelocationFacts>(back->track).effort_sum, 7.5);
}

}  // namespace
}  // namespace myograde::sim
