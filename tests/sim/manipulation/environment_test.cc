// Episodes of the manipulation environment: resets, actions, placement, ends,
// and each switch of the profiles.
#include "sim/manipulation/environment.h"

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/sim/manipulation/helpers.h"

namespace myograde::sim {
namespace {

using Rules = ManipulationRules;

const std::vector<double>& Zeros() {
  static const std::vector<double> zeros(80, 0.0);
  return zeros;
}

const ManipulationFacts& Facts(const EpisodeFacts& facts) {
  return std::get<ManipulationFacts>(facts.track);
}

std::vector<double> Observation(const ManipulationEnvironment& env) {
  std::vector<double> observation(env.observation_size());
  env.Observe(observation);
  return observation;
}

// Puts the box onto the goal pillar, upright, so that it rests there.
void PutOnGoal(ManipulationEnvironment& env, double dx = 0) {
  const Variation& drawn = env.variation();
  PutObject(env, {drawn.goal[0] + dx, drawn.goal[1],
                  env.rules().goal_face_m + drawn.half_size[1] - 0.0005});
}

// Steps with a neutral action until the episode ends or `limit` steps are played.
StepResult PlayOn(ManipulationEnvironment& env, int limit) {
  StepResult result;
  for (int i = 0; i < limit && !result.ended; ++i) result = env.Step(Zeros());
  return result;
}

std::vector<double> StateAfter(ManipulationEnvironment& env, uint64_t seed, int steps) {
  env.Reset(seed);
  std::vector<double> action(80);
  for (int t = 0; t < steps; ++t) {
    for (int i = 0; i < 80; ++i) action[i] = std::sin(0.2 * t + i);
    env.Step(action);
  }
  return {env.state().begin(), env.state().end()};
}

TEST(ManipulationEnvironment, TheSameSeedGivesTheSameEpisodeBitForBit) {
  for (const char* profile : {"paper", "myosuite"}) {
    const auto one = MakeProfile(profile);
    const auto two = MakeProfile(profile);
    StateAfter(*two, 99, 7);  // what was played before leaves no trace
    EXPECT_EQ(StateAfter(*one, 4, 40), StateAfter(*two, 4, 40)) << profile;
    EXPECT_NE(StateAfter(*one, 4, 40), StateAfter(*two, 5, 40)) << profile;
  }
}

TEST(ManipulationEnvironment, StateHasTimePositionsVelocitiesAndActivations) {
  const auto env = MakeProfile("paper");
  env->Reset(0);
  env->Step(Zeros());
  const auto state = env->state();
  ASSERT_EQ(state.size(), 1u + 71 + 70 + 63);
  EXPECT_EQ(state[0], env->data().time);
  EXPECT_EQ(state[1], env->data().qpos[0]);
  EXPECT_EQ(state[72], env->data().qvel[0]);
  EXPECT_EQ(state[142], env->data().act[0]);
}

TEST(ManipulationEnvironment, PaperShowsTheObjectWhereItStarts) {
  const auto env = MakeProfile("paper");
  env->Reset(2);
  const auto observation = Observation(*env);
  EXPECT_EQ(observation[129], env->variation().start[0]);
  EXPECT_EQ(observation[130], env->variation().start[1]);
  EXPECT_DOUBLE_EQ(observation[131], env->variation().start[2] + 0.1);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(observation[142 + i], env->variation().start[i]);
    EXPECT_EQ(observation[145 + i], env->variation().goal[i]);
  }
}

TEST(ManipulationEnvironment, OfficialProfilesShowTheKeyframeFirst) {
  const auto env = MakeProfile("myosuite");
  env->Reset(2);
  EXPECT_EQ(Observation(*env)[129], -0.400023);
  env->Step(Zeros());
  EXPECT_NEAR(Observation(*env)[129], env->variation().start[0], 1e-6);
}

TEST(ManipulationEnvironment, NormalizedActionsGoThroughTheOfficialMap) {
  const auto env = MakeProfile("paper");
  env->Reset(0);
  std::vector<double> action(80, 0.5);
  action[0] = -1;
  action[1] = 1;
  action[63] = 0;
  action[64] = 1;
  env->Step(action);
  const auto controls = OfficialControls(*env);
  EXPECT_NEAR(controls[0], 0.00055, 1e-5);
  EXPECT_NEAR(controls[1], 0.92414, 1e-5);
  EXPECT_EQ(controls[2], 0.5);
  EXPECT_DOUBLE_EQ(controls[63], (-0.611 + 2.792) / 2);
  EXPECT_NEAR(controls[64], 0, 1e-15);
  EXPECT_EQ(env->facts().clipped, 0);
}

TEST(ManipulationEnvironment, PaperClipsAndCountsWhatIsOutOfRange) {
  const auto env = MakeProfile("paper");
  env->Reset(0);
  std::vector<double> action(80, 0.0);
  action[0] = 7;
  action[63] = -3;
  env->Step(action);
  EXPECT_NEAR(OfficialControls(*env)[0], 0.92414, 1e-5);
  EXPECT_DOUBLE_EQ(OfficialControls(*env)[63], -0.611);
  EXPECT_EQ(env->facts().clipped, 2);

  env->SetConvention(ActionConvention::kDirect);
  std::ranges::fill(action, 0.5);
  action[5] = -0.1;
  action[66] = 3;
  env->Step(action);
  EXPECT_EQ(OfficialControls(*env)[4], 0.5);
  EXPECT_EQ(OfficialControls(*env)[5], 0);
  EXPECT_EQ(OfficialControls(*env)[66], 2.356);
  int64_t out_of_range = 0;
  for (int i = 0; i < 80; ++i) {
    const int actuator = i < kMuscles ? env->scene().first_muscle + i
                                      : env->scene().first_servo + i - kMuscles;
    const mjtNum* range = env->model().actuator_ctrlrange + 2 * actuator;
    out_of_range += action[i] < range[0] || action[i] > range[1];
  }
  EXPECT_GE(out_of_range, 2);
  EXPECT_EQ(env->facts().clipped, 2 + out_of_range);
}

TEST(ManipulationEnvironment, OfficialProfilesPassActionsOn) {
  const auto env = MakeProfile("myosuite");
  env->Reset(0);
  env->SetConvention(ActionConvention::kDirect);
  std::vector<double> action(80, 0.5);
  action[5] = -0.1;
  action[66] = 3;
  env->Step(action);
  EXPECT_EQ(OfficialControls(*env)[5], -0.1);
  EXPECT_EQ(OfficialControls(*env)[66], 3);
  EXPECT_EQ(env->facts().clipped, 0);
}

TEST(ManipulationEnvironment, LegParametersAreRefused) {
  const auto env = MakeProfile("paper");
  EXPECT_TRUE(env->SetParameters(nlohmann::json::object()).ok());
  EXPECT_EQ(env->SetParameters({{"1", {}}}).code(), absl::StatusCode::kInvalidArgument);
}

TEST(ManipulationEnd, PaperEndsWhenTheObjectWasPlacedForEightFrames) {
  const auto env = MakeProfile("paper");
  env->Reset(3);
  PutOnGoal(*env);
  const StepResult result = PlayOn(*env, 100);
  const EpisodeFacts facts = env->facts();
  ASSERT_TRUE(result.ended);
  EXPECT_EQ(facts.end, ManipulationEnd::kPlaced);
  EXPECT_GE(facts.steps, 8);
  EXPECT_LT(facts.steps, 60);
  EXPECT_TRUE(Facts(facts).placed);
  EXPECT_TRUE(Facts(facts).goal_only_at_end);
  EXPECT_GE(Facts(facts).frames_goal, 8);
  EXPECT_EQ(Facts(facts).frames, facts.steps);
}

TEST(ManipulationEnd, PaperJudgesEachAxisByTheBoxCentre) {
  const auto env = MakeProfile("paper");
  env->Reset(3);
  PutOnGoal(*env, 0.12);  // still on the pillar of radius 0.15, but too far in x
  EXPECT_FALSE(PlayOn(*env, 60).ended);
  EXPECT_GT(Facts(env->facts()).frames_goal, 20);
  EXPECT_FALSE(Facts(env->facts()).placed);
  PutOnGoal(*env, 0.09);
  EXPECT_TRUE(PlayOn(*env, 60).ended);
  EXPECT_EQ(env->facts().end, ManipulationEnd::kPlaced);
}

TEST(ManipulationEnd, OfficialEndComesOneStepAfterTheFlag) {
  Rules rules = RulesOf("myosuite");
  for (const bool lags : {true, false}) {
    rules.end_lags_solved = lags;
    const auto env = MakeEnvironmentWith(rules);
    env->Reset(3);
    PutOnGoal(*env);
    PlayOn(*env, 100);
    const EpisodeFacts facts = env->facts();
    EXPECT_EQ(facts.end, ManipulationEnd::kPlaced);
    EXPECT_TRUE(Facts(facts).solved);
    EXPECT_EQ(Facts(facts).solved_steps, lags ? 2 : 1);
  }
}

TEST(ManipulationEnd, ADropIsBelowTheHeightOnly) {
  for (const char* profile : {"paper", "myosuite"}) {
    const auto env = MakeProfile(profile);
    env->Reset(3);
    PutObject(*env, {0, -0.9, 0.35});
    EXPECT_FALSE(env->Step(Zeros()).ended) << profile;
    const StepResult result = PlayOn(*env, 30);
    EXPECT_TRUE(result.ended);
    EXPECT_EQ(env->facts().end, ManipulationEnd::kDropped);
    EXPECT_EQ(Facts(env->facts()).reported_time, 10);
    EXPECT_LT(env->facts().sim_time, 1);
  }
}

TEST(ManipulationEnd, TimeIsUpAfterTheLastStep) {
  Rules rules = RulesOf("paper");
  rules.max_steps = 5;
  auto env = MakeEnvironmentWith(rules);
  env->Reset(0);
  PlayOn(*env, 10);
  EXPECT_EQ(env->facts().end, EpisodeEnd::kTime);
  EXPECT_EQ(env->facts().steps, 5);
  rules.max_steps = 1000;
  rules.max_time_s = 0.025;
  env = MakeEnvironmentWith(rules);
  env->Reset(0);
  PlayOn(*env, 10);
  EXPECT_EQ(env->facts().end, EpisodeEnd::kTime);
  EXPECT_EQ(env->facts().steps, 3);
}

TEST(ManipulationEnd, ThePhantomEpisodeFollowsASolvedOne) {
  Rules rules = RulesOf("as-graded");
  for (const bool phantom : {true, false}) {
    rules.phantom_trials = phantom;
    const auto env = MakeEnvironmentWith(rules);
    env->Reset(3);
    PutOnGoal(*env);
    PlayOn(*env, 100);
    ASSERT_TRUE(Facts(env->facts()).solved);
    env->Reset(4);
    EXPECT_EQ(env->Step(Zeros()).ended, phantom);
    if (phantom) {
      EXPECT_EQ(env->facts().end, ManipulationEnd::kPhantom);
      EXPECT_FALSE(Facts(env->facts()).solved);
      env->Reset(5);
      EXPECT_FALSE(env->Step(Zeros()).ended) << "only the next episode is one";
    }
  }
}

TEST(ManipulationCarry, OneEnvironmentGoesOnDrawing) {
  const auto env = MakeProfile("as-graded");
  env->Reset(3);
  EXPECT_EQ(env->variation().half_size, env->rules().half_size_m) << "not drawn at first";
  const auto first = env->variation().start;
  env->Reset(3);
  EXPECT_NE(env->variation().start, first) << "the seed counts once";
  EXPECT_NE(env->variation().half_size, env->rules().half_size_m);
  const auto other = MakeProfile("as-graded");
  other->Reset(3);
  other->Reset(1234);
  EXPECT_EQ(other->variation().start, env->variation().start);
}

TEST(ManipulationCarry, ThePeakOfTheTouchSensorSurvivesWhereTheRulesSaySo) {
  Rules rules = RulesOf("as-graded");
  for (const bool survives : {true, false}) {
    rules.peak_touch_survives_reset = survives;
    const auto env = MakeEnvironmentWith(rules);
    env->Reset(3);
    PutOnGoal(*env);
    PlayOn(*env, 3);
    const double peak = Facts(env->facts()).max_touch;
    ASSERT_GT(peak, 0);
    env->Reset(3);
    EXPECT_EQ(Facts(env->facts()).max_touch, survives ? peak : 0);
    EXPECT_EQ(Facts(env->facts()).peak_force, 0) << "the force over all steps starts anew";
  }
}

TEST(ManipulationFacts, TheFrameOfTheResetCountsInTheOfficialProfilesOnly) {
  const auto paper = MakeProfile("paper");
  paper->Reset(0);
  paper->Step(Zeros());
  EXPECT_EQ(Facts(paper->facts()).frames, 1);
  const auto official = MakeProfile("myosuite");
  official->Reset(0);
  official->Step(Zeros());
  EXPECT_EQ(Facts(official->facts()).frames, 2);
}

TEST(ManipulationFacts, PeakForceSeesWhatTheControlRateMisses) {
  const auto env = MakeProfile("paper");
  env->Reset(3);
  PlayOn(*env, 30);  // the box falls onto the start pillar
  const ManipulationFacts facts = Facts(env->facts());
  EXPECT_GT(facts.frames_start, 0);
  EXPECT_GT(facts.max_touch, 0);
  EXPECT_GE(facts.peak_force, facts.max_touch * (1 - 1e-9));
  EXPECT_GT(facts.peak_force, 0.147 * 9.81) << "more than the weight";
}

TEST(ManipulationFacts, LiftingShowsInTheHeight) {
  const auto env = MakeProfile("paper");
  env->Reset(3);
  EXPECT_EQ(Facts(env->facts()).max_height, 0);
  PlayOn(*env, 5);
  EXPECT_EQ(Facts(env->facts()).max_height, 0) << "falling is no lift";
  PutObject(*env, {0, -0.6, 1.6});
  env->Step(Zeros());
  EXPECT_NEAR(Facts(env->facts()).max_height, 1.6 - 1.15, 0.01);
}

TEST(ManipulationFaults, BadNumbersAreUnstableOrResetTheOfficialSimulation) {
  const auto paper = MakeProfile("paper");
  paper->Reset(0);
  paper->data().qvel[3] = 1e12;
  EXPECT_TRUE(paper->Step(Zeros()).unstable);

  const auto official = MakeProfile("myosuite");
  official->Reset(0);
  official->Step(Zeros());
  official->data().qvel[3] = 1e12;
  const StepResult result = official->Step(Zeros());
  EXPECT_FALSE(result.unstable);
  EXPECT_EQ(official->data().time, 0) << "back to the model's start, as the official code does";
}

}  // namespace
}  // namespace myograde::sim
