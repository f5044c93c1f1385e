// Episodes of chase-tag: what is drawn, the field, the opponent, observations, ends, and each
// switch of the rules.
#include "sim/chasetag/environment.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "protocol/lease/lease.h"
#include "protocol/lease/sim_channel.h"
#include "protocol/tracks/chasetag/track.h"
#include "tests/sim/chasetag/helpers.h"

namespace myograde::sim {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kOpponent = 64, kRoot = 69;   // in the observation
constexpr uint64_t kChase = 1, kEvade = 0;  // seeds of the two tasks

const std::vector<double>& Rest() {
  static const std::vector<double> rest(80, -1.0);
  return rest;
}

Vector2d Root(const ChaseTagEnvironment& env) { return Vector2d::Map(env.data().qpos); }

// Puts the opponent so far from the person, along x.
void PutOpponent(ChaseTagEnvironment& env, double distance) {
  const mjtNum* pelvis = env.data().xpos + 3 * env.scene().pelvis_body;
  env.data().mocap_pos[0] = pelvis[0] + distance;
  env.data().mocap_pos[1] = pelvis[1];
}

std::vector<double> StateAfterWaves(ChaseTagEnvironment& env, uint64_t seed) {
  env.Reset(seed);
  std::vector<double> action(80);
  for (int t = 0; t < 10; ++t) {
    for (int i = 0; i < 80; ++i) action[static_cast<size_t>(i)] = std::sin(0.2 * t + i);
    env.Step(action);
  }
  std::vector<double> all(env.state().begin(), env.state().end());
  const std::vector<double> seen = Observed(env);
  all.insert(all.end(), seen.begin(), seen.end());
  return all;
}

TEST(ChaseTagEnvironment, TheSameSeedGivesTheSameEpisodeBitForBit) {
  const auto one = MakeChase();
  const auto two = MakeChase();
  const std::vector<double> first = StateAfterWaves(*one, 7);
  EXPECT_EQ(first, StateAfterWaves(*two, 7));
  EXPECT_NE(first, StateAfterWaves(*one, 8));
  EXPECT_EQ(first, StateAfterWaves(*one, 7)) << "nothing is left of the episode before";
}

TEST(ChaseTagReset, DrawsTasksPoliciesAndPlacesWithinTheirRanges) {
  const auto env = MakeChase();
  std::set<int> policies;
  int chases = 0;
  for (uint64_t seed = 0; seed < 60; ++seed) {
    env->Reset(seed);
    const ChaseTagFacts facts = FactsOf(*env);
    policies.insert(facts.opponent);
    chases += !facts.evades;
    EXPECT_EQ(facts.evades, facts.opponent == static_cast<int>(OpponentPolicy::kChasing));
    EXPECT_LE(Root(*env).cwiseAbs().maxCoeff(), 5);
    const Vector3d pose = Opponent::PoseOf(env->data());
    if (env->opponent().policy() == OpponentPolicy::kAtTheEdge) {
      EXPECT_EQ(pose.head<2>(), Vector2d(0, -5));
    } else {
      EXPECT_GE((pose.head<2>() - Root(*env)).norm(), 2);
    }
    EXPECT_EQ(env->data().qpos[2], 1);
    EXPECT_NEAR(Vector2d::Map(env->data().qvel).norm(), 1.5, 1e-12);
  }
  EXPECT_EQ(policies, (std::set<int>{0, 1, 2, 3, 4}));
  EXPECT_GT(chases, 15);
  EXPECT_LT(chases, 45);
}

TEST(ChaseTagField, HasLevelHillyAndRoughPatchesAndNowAndThenTheRelief) {
  const auto env = MakeChase();
  NumpyGenerator generator(3);
  ChaseTagField field(env->scene().relief);
  ChaseTagRules rules = ChaseRules();
  rules.relief_share = 0;
  float lowest = 0, highest = 0;
  int most_hilly = 0;
  for (int i = 0; i < 40; ++i) {
    field.Draw(rules, generator);
    const auto heights =
        Eigen::Map<const Eigen::Array<float, 100, 100, Eigen::RowMajor>>(field.heights().data());
    lowest = std::min(lowest, heights.minCoeff());
    highest = std::max(highest, heights.maxCoeff());
    EXPECT_EQ(heights.row(99).abs().maxCoeff(), 0);
    EXPECT_EQ(heights.col(99).abs().maxCoeff(), 0);
    int hilly = 0;
    for (int patch = 0; patch < 9; ++patch) {
      const auto samples = heights.block<33, 33>(33 * (patch / 3), 33 * (patch % 3));
      hilly += samples.minCoeff() == 0 && samples.maxCoeff() > 0;
    }
    most_hilly = std::max(most_hilly, hilly);
  }
  EXPECT_EQ(most_hilly, 2);
  EXPECT_FLOAT_EQ(lowest, -0.02f);
  EXPECT_TRUE(highest > 0.15f && highest < 0.23f) << highest;
  rules.relief_share = 1;
  rules.relief_m = {0.9, 0.9};
  field.Draw(rules, generator);
  EXPECT_FLOAT_EQ(*std::ranges::max_element(field.heights()), 0.9f);
}

TEST(ChaseTagField, LevelsThePatchBeyondTheDiagonalUnlessItIsToldNotTo) {
  const auto env = MakeChase();
  ChaseTagRules rules = ChaseRules();
  rules.relief_share = 0;
  for (const bool mirrored : {true, false}) {
    ChaseTagField field(env->scene().relief);
    NumpyGenerator generator(0);
    const auto level = [&](int row, int column) {
      for (int r = 0; r < 33; ++r) {
        for (int c = 0; c < 33; ++c) {
          if (field.heights()[static_cast<size_t>(100 * (33 * row + r) + 33 * column + c)] != 0) {
            return false;
          }
        }
      }
      return true;
    };
    do {
      field.Draw(rules, generator);
    } while (level(0, 2) || level(2, 0));
    field.Level(4, -4, mirrored);  // x is along columns: the true patch has row 0, column 2
    EXPECT_EQ(level(0, 2), !mirrored);
    EXPECT_EQ(level(2, 0), mirrored);
  }
}

TEST(ChaseTagReset, ShowsNoOpponentAtFirstUnlessTheRulesSayOtherwise) {
  ChaseTagRules rules = ChaseRules();
  const auto official = MakeChase(rules);
  rules.first_observation_before_opponent = false;
  const auto plain = MakeChase(rules);
  const auto shown = [](const ChaseTagEnvironment& env) -> Vector3d {
    return Vector3d::Map(Observed(env).data() + kOpponent);
  };
  official->Reset(kChase), plain->Reset(kChase);
  EXPECT_EQ(shown(*official), Vector3d::Zero());
  EXPECT_EQ(shown(*plain), Opponent::PoseOf(plain->data()));
  EXPECT_NE(shown(*plain), Vector3d::Zero());
  official->Step(Rest()), plain->Step(Rest());
  EXPECT_EQ(shown(*official), shown(*plain));
}

TEST(ChaseTagReset, TheStartLeansUnlessItsOrientationHasNoNoise) {
  ChaseTagRules rules = ChaseRules();
  const auto official = MakeChase(rules);
  rules.orientation_with_noise = false;
  const auto upright = MakeChase(rules);
  official->Reset(kChase), upright->Reset(kChase);
  const auto up = [](const ChaseTagEnvironment& env) {
    Rotation rotation;
    mju_quat2Mat(rotation.data(), env.data().qpos + 3);
    return rotation(2, 2);
  };
  EXPECT_LT(up(*official), 1 - 1e-5);
  EXPECT_NEAR(up(*upright), 1, 1e-12);
  EXPECT_EQ(official->data().qpos[10], upright->data().qpos[10]);
}

// Plays an opponent alone, the person standing at the origin.
struct Played {
  Opponent opponent;
  mjData& data;
  NumpyGenerator generator;

  Played(const ChaseTagRules& rules, ChaseTagEnvironment& env, bool chased, uint64_t seed)
      : opponent(rules), data(env.data()), generator(seed) {
    opponent.Reset(chased, Vector2d::Zero(), generator, data);
  }
  Vector2d Moved(const Vector2d& pelvis = Vector2d::Zero()) {
    const Vector2d before = Vector2d::Map(data.mocap_pos);
    opponent.Move(pelvis, 0.01, generator, data);
    return Vector2d::Map(data.mocap_pos) - before;
  }
};

TEST(ChaseTagOpponent, StandsStillOrWandersOnTheField) {
  const auto env = MakeChase();
  ChaseTagRules rules = ChaseRules();
  rules.opponent_shares = {0, 1, 0, 0};
  Played still(rules, *env, true, 1);
  EXPECT_EQ(still.Moved().norm(), 0);
  rules.opponent_shares = {0, 0, 1, 0};
  Played wandering(rules, *env, true, 1);
  double longest = 0;
  for (int t = 0; t < 4100; ++t) {  // the noise begins anew after 2,000 samples
    longest = std::max(longest, wandering.Moved().norm());
    ASSERT_LE(Vector2d::Map(env->data().mocap_pos).cwiseAbs().maxCoeff(), 5.5);
    ASSERT_GE(wandering.opponent.velocity().x(), 0);
  }
  EXPECT_NEAR(longest, 0.02, 1e-9) << "2 m/s";
}

TEST(ChaseTagOpponent, ChasesThePersonAndShowsTheSpeedThatItWants) {
  const auto env = MakeChase();
  ChaseTagRules rules = ChaseRules();
  rules.chase_speed = {4, 4};
  for (const bool unclipped : {true, false}) {
    rules.opponent_speed_unclipped = unclipped;
    Played chasing(rules, *env, false, 5);
    EXPECT_EQ(chasing.opponent.policy(), OpponentPolicy::kChasing);
    double nearest = 10;
    for (int t = 0; t < 1000; ++t) {
      ASSERT_LE(chasing.Moved().norm(), 0.02 + 1e-12);
      nearest = std::min(nearest, Vector2d::Map(env->data().mocap_pos).norm());
    }
    EXPECT_LT(nearest, 0.5);
    EXPECT_EQ(chasing.opponent.velocity().x(), unclipped ? 4 : 2);
  }
}

TEST(ChaseTagOpponent, IsRepelledByThePersonAndTheWalls) {
  const auto env = MakeChase();
  ChaseTagRules rules = ChaseRules();
  rules.opponent_shares = {0, 0, 0, 1};
  Played repelled(rules, *env, true, 2);
  const auto moved_with = [&](const Vector3d& pose, const Vector2d& pelvis) {
    Vector2d::Map(env->data().mocap_pos) = pose.head<2>();
    Eigen::Vector4d::Map(env->data().mocap_quat) = OfficialQuaternion({0, 0, pose.z()});
    return repelled.Moved(pelvis);
  };
  moved_with({0, 0, 0}, {1, 0.5});
  EXPECT_EQ(repelled.opponent.velocity().x(), 1) << "as fast as it may";
  moved_with({0, 0, 0}, {3, 1.5});
  EXPECT_EQ(repelled.opponent.velocity().x(), 0.3) << "the person is hardly in reach";
  // Away from (1, 1) it is turned by -3/4 pi + 1.57, which is 5.5: the wrapped angle goes there.
  for (const double angle : {0.1, 5.0, 6.0}) {
    moved_with({0, 0, angle}, {1, 1});
    EXPECT_EQ(repelled.opponent.velocity().y(), angle < 5.5 ? 1 : -1) << angle;
  }
  moved_with({0, 0, 0}, {5, 5});
  EXPECT_EQ(std::abs(repelled.opponent.velocity().y()), 1) << "nothing in reach: at random";
  // Straight before a wall it can't tell where to go, and draws.
  const auto before = repelled.generator.state();
  moved_with({5.4, 0, 0}, {-5, 0});
  EXPECT_NE(repelled.generator.state(), before);
}

TEST(ChaseTagObservation, HasOfficialOrderAndScales) {
  ChaseTagRules rules = ChaseRules();
  const auto official = MakeChase(rules);
  rules.velocities_times_step = false;
  const auto plain = MakeChase(rules);
  StateAfterWaves(*official, kEvade), StateAfterWaves(*plain, kEvade);
  const std::vector<double> seen = Observed(*official);
  for (size_t i = 0; i < 28; ++i) {
    EXPECT_EQ(seen[i], official->data().qpos[7 + i]);
    EXPECT_EQ(Observed(*plain)[28 + i], plain->data().qvel[6 + i]);
    EXPECT_DOUBLE_EQ(seen[28 + i], 0.01 * official->data().qvel[6 + i]);
  }
  EXPECT_EQ(Vector2d::Map(seen.data() + kRoot), Root(*official));
  EXPECT_EQ(seen.back(), official->data().act[79]);
  std::vector<double> extra(107);
  official->ObserveExtra(extra);
  EXPECT_EQ(extra[0], official->data().time);
  EXPECT_EQ(extra[1], 1) << "evades";
  EXPECT_TRUE(std::equal(extra.begin() + 102, extra.end(), seen.begin() + kOpponent));
}

TEST(ChaseTagEnd, ATagWinsTheChaseAndLosesTheEvasion) {
  for (const uint64_t seed : {kChase, kEvade}) {
    const auto env = MakeChase();
    env->Reset(seed);
    EXPECT_FALSE(env->Step(Rest()).ended);
    EXPECT_EQ(Rewards(*env)[5], 0);
    PutOpponent(*env, 0.3);
    EXPECT_TRUE(env->Step(Rest()).ended);
    const bool chase = seed == kChase;
    EXPECT_EQ(env->facts().end, chase ? ChaseTagEnd::kTagged : ChaseTagEnd::kCaught);
    EXPECT_EQ(FactsOf(*env).solved, chase);
    const std::vector<double> terms = Rewards(*env);
    EXPECT_EQ(terms[2], !chase);
    EXPECT_DOUBLE_EQ(terms[3], chase ? 1 - 0.02 / 20 : 0.02 / 20);
    EXPECT_EQ(terms[4], chase);
    EXPECT_EQ(terms[5], 1);
    EXPECT_DOUBLE_EQ(FactsOf(*env).reported_time, env->data().time);
  }
}

TEST(ChaseTagEnd, OutOfBoundsLosesBoth) {
  for (const uint64_t seed : {kChase, kEvade}) {
    const auto env = MakeChase();
    env->Reset(seed);
    env->data().qpos[0] = 6.6;
    env->SynchroniseState();
    EXPECT_TRUE(env->Step(Rest()).ended);
    EXPECT_EQ(env->facts().end, ChaseTagEnd::kOutOfBounds);
    EXPECT_EQ(Rewards(*env)[2], 1);
    EXPECT_EQ(FactsOf(*env).reported_time, seed == kChase ? 20 : env->data().time);
  }
}

TEST(ChaseTagEnd, AFallLosesTheChaseOnly) {
  for (const uint64_t seed : {kChase, kEvade}) {
    const auto env = MakeChase();
    env->Reset(seed);
    PutOpponent(*env, 4);
    Eigen::Vector4d::Map(env->data().qpos + 3) = Eigen::Vector4d(0, 1, 0, 0);  // head down
    env->data().qpos[2] = 2;
    env->SynchroniseState();
    EXPECT_EQ(env->Step(Rest()).ended, seed == kChase);
    EXPECT_EQ(env->facts().end == ChaseTagEnd::kFell, seed == kChase);
  }
}

TEST(ChaseTagEnd, TheTimeLimitLosesTheChaseAndWinsTheEvasion) {
  ChaseTagRules rules = ChaseRules();
  rules.time_limit_s = 0.05;
  for (const uint64_t seed : {kChase, kEvade}) {
    const auto env = MakeChase(rules);
    env->Reset(seed);
    for (int t = 1; t < 5; ++t) ASSERT_FALSE(env->Step(Rest()).ended) << t;
    // Fifty steps of a millisecond add up to a bit more or less than 0.05 s.
    while (!env->Step(Rest()).ended) {
    }
    EXPECT_EQ(env->facts().end, EpisodeEnd::kTime);
    EXPECT_EQ(FactsOf(*env).solved, seed == kEvade);
  }
}

TEST(ChaseTagEnd, AnEpisodeOfFewerStepsIsNeitherWonNorLost) {
  ChaseTagRules rules = ChaseRules();
  rules.max_steps = 3;
  const auto env = MakeChase(rules);
  env->Reset(kEvade);
  while (!env->Step(Rest()).ended) {
  }
  EXPECT_EQ(env->facts().steps, 3);
  EXPECT_EQ(env->facts().end, EpisodeEnd::kTime);
  EXPECT_FALSE(FactsOf(*env).solved);
}

TEST(ChaseTagFacts, MeasureDistancesEffortAndJoints) {
  const auto env = MakeChase();
  env->Reset(kEvade);
  EXPECT_FALSE(env->details().has_value());
  double smallest = 100, effort = 0;
  for (int t = 0; t < 10; ++t) {
    env->Step(std::vector<double>(80, 0.3));
    effort += Rewards(*env)[0];
    smallest = std::min(smallest, FactsOf(*env).final_distance);
  }
  EXPECT_EQ(FactsOf(*env).smallest_distance, smallest);
  EXPECT_NEAR(FactsOf(*env).effort_sum, effort, 1e-12);
  const auto details = std::get<ChaseTagDetails>(env->details().value());
  EXPECT_FALSE(details.solved_time.has_value());
  EXPECT_DOUBLE_EQ(details.joint_ranges[0].limit_high, env->model().jnt_range[3]);
}

TEST(ChaseTagFaults, BadNumbersAreUnstableOrResetTheOfficialSimulation) {
  ChaseTagRules rules = ChaseRules();
  const auto official = MakeChase(rules);
  rules.warnings_reset_simulation = false;
  const auto strict = MakeChase(rules);
  for (auto* env : {official.get(), strict.get()}) {
    env->Reset(kEvade);
    env->Step(Rest());
    env->data().qvel[8] = 1e12;
  }
  EXPECT_TRUE(strict->Step(Rest()).unstable);
  EXPECT_FALSE(official->Step(Rest()).unstable);
  EXPECT_EQ(official->data().time, 0) << "back to the model's start, as the official code does";
}

TEST(ChaseTagLayout, NamesWhatTheModelHasInItsOrder) {
  const TrackLayout& layout = ChaseTagTrack().layout();
  const auto env = MakeChase();
  ASSERT_EQ(layout.observation.size(), env->observation_size());
  ASSERT_EQ(layout.action.size(), env->action_size());
  ASSERT_EQ(layout.extra.size(), 107);
  EXPECT_EQ(layout.direct_bounds.size(), 80);
  EXPECT_DOUBLE_EQ(ChaseTagTrack().control_period_s,
                   ChaseTagEnvironment::kPhysicsSteps * env->model().opt.timestep);
  for (int i = 0; i < 80; ++i) {
    const std::string muscle = mj_id2name(&env->model(), mjOBJ_ACTUATOR, i);
    EXPECT_EQ(layout.action.names()[static_cast<size_t>(i)], "muscles." + muscle);
  }
  for (int i = 0; i < 28; ++i) {
    const std::string joint = mj_id2name(&env->model(), mjOBJ_JOINT, i + 1);
    EXPECT_EQ(layout.observation.names()[static_cast<size_t>(i)], "internal_qpos." + joint);
    EXPECT_NEAR(layout.observation.bounds()[static_cast<size_t>(i)].high,
                env->model().jnt_range[2 * i + 3], 1e-3);
  }
}

TEST(ChaseTagFacts, SurviveTheirJson) {
  EpisodeFacts facts;
  facts.end = ChaseTagEnd::kOutOfBounds;
  auto& chase = facts.track.emplace<ChaseTagFacts>();
  double next = 1;
  ChaseTagFacts::Visit(chase, [&](const char*, auto& value) {
    value = static_cast<std::remove_reference_t<decltype(value)>>(next++);
  });
  const auto back = EpisodeFactsFromJson(EpisodeFactsToJson(facts));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(EpisodeFactsToJson(*back), EpisodeFactsToJson(facts));
  EXPECT_EQ(std::get<ChaseTagFacts>(back->track).effort_sum, 7);
}

}  // namespace
}  // namespace myograde::sim
