// The environment as the episode loop sees it: actions, observation, sets,
// repeatability and faults of the simulation.
#include "sim/locomotion/environment.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/bridge/leg_sets_json.h"
#include "protocol/tracks/locomotion/track.h"
#include "sim/locomotion/track.h"
#include "tests/sim/golden.h"
#include "tests/sim/locomotion/allocations.h"
#include "tests/sim/locomotion/fixture.h"

namespace myograde::sim {
namespace {

using ::testing::HasSubstr;

std::unique_ptr<LocomotionEnvironment> Profile(const std::string& name) {
  return MakeEnvironment(ParsedRules(ShippedRules(name)));
}

std::vector<double> Observation(const LocomotionEnvironment& environment) {
  std::vector<double> out(LocomotionEnvironment::kObservationSize);
  environment.Observe(out);
  return out;
}

TEST(LocomotionActions, PaperClipsAndCounts) {
  auto environment = Profile("paper");
  environment->Reset(4);
  std::vector<double> action = ConstantAction(0.2);
  environment->Step(action);
  EXPECT_EQ(environment->facts().clipped, 0);
  action[3] = 1.5;
  action[9] = -7e300;
  action.back() = 9;
  environment->Step(action);
  EXPECT_EQ(environment->facts().clipped, 3);
  const LocomotionIndices& at = environment->indices();
  EXPECT_DOUBLE_EQ(environment->data().ctrl[at.muscle[3]], 1 / (1 + std::exp(-2.5)));
  EXPECT_DOUBLE_EQ(environment->data().ctrl[at.muscle[9]], 1 / (1 + std::exp(7.5)));
  EXPECT_EQ(environment->leg().selected(), 4);
}

TEST(LocomotionActions, DirectGivesMusclesTheirControls) {
  auto environment = Profile("paper");
  environment->Reset(4);
  environment->SetConvention(ActionConvention::kDirect);
  std::vector<double> action = ConstantAction(0.25);
  action[0] = -0.5;  // below [0, 1]
  environment->Step(action);
  EXPECT_EQ(environment->facts().clipped, 1);
  const LocomotionIndices& at = environment->indices();
  EXPECT_EQ(environment->data().ctrl[at.muscle[0]], 0);
  EXPECT_EQ(environment->data().ctrl[at.muscle[1]], 0.25);
}

TEST(LocomotionActions, MyosuitePassesOnWhatIsOutside) {
  auto environment = Profile("myosuite");
  environment->Reset(4);
  std::vector<double> action = ConstantAction(2);
  environment->Step(action);
  EXPECT_EQ(environment->facts().clipped, 0);
  EXPECT_DOUBLE_EQ(environment->data().ctrl[environment->indices().muscle[5]],
                   1 / (1 + std::exp(-7.5)));
}

TEST(LocomotionActions, SetIsRoundedAndClamped) {
  auto paper = Profile("paper");
  paper->Reset(1);
  for (const auto& [value, set] : std::vector<std::pair<double, int>>{
           {0.4, 0}, {0.6, 1}, {3.4, 3}, {4, 4}, {1e300, 4}, {-1e300, 0}}) {
    paper->Step(ConstantAction(0, value));
    EXPECT_EQ(paper->leg().selected(), set) << value;
  }
  auto myosuite = Profile("myosuite");
  myosuite->Reset(1);
  myosuite->Step(ConstantAction(0, 4));
  EXPECT_EQ(myosuite->leg().selected(), 3);
}

TEST(LocomotionLeg, PaperDeliversTheTorqueAndMyosuiteOnlyAPart) {
  for (const bool paper : {true, false}) {
    for (const bool direct : {true, false}) {
      auto environment = Profile(paper ? "paper" : "myosuite");
      environment->Reset(2);
      if (direct) environment->SetConvention(ActionConvention::kDirect);
      LegController twin = environment->leg();
      const LegTorques torques = twin.Update(environment->SenseLeg());
      environment->Step(ConstantAction(0));
      const double part = paper || direct ? 1 : 1 / 2.88;
      EXPECT_NEAR(environment->data().ctrl[environment->indices().knee_motor],
                  torques.knee / 49.4 * part, 1e-12);
      EXPECT_NEAR(environment->data().ctrl[environment->indices().ankle_motor],
                  torques.ankle / 58.4 * part, 1e-12);
    }
  }
}

TEST(LocomotionLeg, UploadedSetsActAtOnceAndEndWithTheEpisode) {
  auto environment = Profile("paper");
  environment->Reset(2);
  LegParameterSets sets{};
  sets.present = 1;
  std::copy(DefaultLegSet().begin(), DefaultLegSet().end(), std::begin(sets.set[0]));
  for (auto& state : sets.set[0]) state.knee_stiffness = state.knee_damping = 0;
  ASSERT_TRUE(environment->SetParameters(LegSetsToJson(sets)).ok());
  environment->Step(ConstantAction(0));
  EXPECT_EQ(environment->data().ctrl[environment->indices().knee_motor], 0);
  environment->Reset(2);
  environment->Step(ConstantAction(0));
  EXPECT_NE(environment->data().ctrl[environment->indices().knee_motor], 0);

  sets.set[0][2].ankle_stiffness = 2001;
  const absl::Status refused = environment->SetParameters(LegSetsToJson(sets));
  EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(refused.message()),
              HasSubstr("leg parameter set 0, state e_swing: ankle_stiffness is 2001"));
}

TEST(LocomotionObservation, ShowsJointVelocitiesPerSecondOrPerStep) {
  auto paper = Profile("paper");
  auto myosuite = Profile("myosuite");
  for (LocomotionEnvironment* environment : {paper.get(), myosuite.get()}) {
    environment->Reset(3);
    for (int t = 0; t < 5; ++t) environment->Step(SineAction(t));
    const std::vector<double> seen = Observation(*environment);
    const double scale = environment == paper.get() ? 1 : 0.005;
    for (int i = 0; i < kObservedJoints; ++i) {
      EXPECT_EQ(seen[2 + i], environment->data().qpos[environment->indices().joint_qpos[i]]);
      EXPECT_EQ(seen[19 + i],
                environment->data().qvel[environment->indices().joint_dof[i]] * scale);
    }
    EXPECT_DOUBLE_EQ(seen[0], 0.025);
    EXPECT_EQ(seen[1], static_cast<double>(environment->terrain().kind()));
    EXPECT_EQ(seen[261], environment->data().qpos[0]);
    EXPECT_EQ(seen[264], environment->data().qvel[1]);
    for (const double number : seen) EXPECT_TRUE(std::isfinite(number));
  }
}

// What follows the dot in an entry's name, the model's name of it.
std::string ModelName(std::string_view entry) {
  return std::string(entry.substr(entry.find('.') + 1));
}

TEST(LocomotionObservation, IsOrderedAsTheLayoutSays) {
  auto environment = Profile("paper");
  const mjModel& m = environment->model();
  const LocomotionIndices& at = environment->indices();
  ASSERT_EQ(ObservationOf(LocomotionTrack()).size(), LocomotionEnvironment::kObservationSize);
  ASSERT_EQ(ActionOf(LocomotionTrack()).size(), LocomotionEnvironment::kActionSize);
  const auto names = ObservationOf(LocomotionTrack()).names();
  for (const Part& part : ObservationOf(LocomotionTrack()).parts()) {
    for (int i = 0; i < part.size; ++i) {
      const std::string name = ModelName(names[part.offset + i]);
      if (part.name == "internal_qpos") {
        EXPECT_EQ(m.jnt_qposadr[mj_name2id(&m, mjOBJ_JOINT, name.c_str())], at.joint_qpos[i]);
      } else if (part.name == "internal_qvel") {
        EXPECT_EQ(m.jnt_dofadr[mj_name2id(&m, mjOBJ_JOINT, name.c_str())], at.joint_dof[i]);
      } else if (part.name == "act") {
        EXPECT_EQ(mj_name2id(&m, mjOBJ_ACTUATOR, name.c_str()), at.muscle[i]) << name;
      } else if (part.name.starts_with("muscle_")) {
        EXPECT_EQ(mj_name2id(&m, mjOBJ_ACTUATOR, name.c_str()), at.sorted_muscle[i]) << name;
      }
    }
  }
  for (int i = 0; i < kLegMuscles; ++i) {
    const std::string name = ModelName(ActionOf(LocomotionTrack()).names()[i]);
    EXPECT_EQ(mj_name2id(&m, mjOBJ_ACTUATOR, name.c_str()), at.muscle[i]) << name;
  }
}

TEST(LocomotionRepeats, TheSameSeedGivesTheSameBits) {
  for (const char* profile : {"paper", "myosuite"}) {
    auto one = Profile(profile);
    auto two = Profile(profile);
    // The second has lived through another episode before.
    two->Reset(99);
    for (int t = 0; t < 10; ++t) two->Step(ConstantAction(0.8));
    one->Reset(7);
    two->Reset(7);
    for (int t = 0; t < 40; ++t) {
      ASSERT_TRUE(std::ranges::equal(one->state(), two->state())) << profile << " " << t;
      ASSERT_EQ(Observation(*one), Observation(*two)) << profile << " " << t;
      one->Step(SineAction(t));
      two->Step(SineAction(t));
    }
  }
}

TEST(LocomotionRepeats, FactsAddUpTheSteps) {
  auto environment = Profile("paper");
  environment->Reset(7);
  double effort = 0, pain = 0, min_y = 1e9;
  for (int t = 0; t < 30; ++t) {
    ASSERT_FALSE(environment->Step(SineAction(t)).ended);
    effort += environment->terms().effort;
    pain += environment->terms().pain;
    min_y = std::min(min_y, environment->data().qpos[1]);
  }
  const EpisodeFacts facts = environment->facts();
  const auto& walk = std::get<LocomotionFacts>(facts.track);
  EXPECT_EQ(facts.steps, 30);
  EXPECT_NEAR(facts.sim_time, 0.15, 1e-12);
  EXPECT_DOUBLE_EQ(walk.effort_sum, effort);
  EXPECT_DOUBLE_EQ(walk.pain_sum, pain);
  EXPECT_EQ(walk.min_y, min_y);
  EXPECT_DOUBLE_EQ(walk.distance, 55 - min_y);
  EXPECT_GT(effort, 0);
}

TEST(LocomotionFaults, BadNumbersAreUnstable) {
  auto environment = Profile("paper");
  environment->Reset(1);
  const mjModel& m = environment->model();
  const std::vector<double> qpos(environment->data().qpos, environment->data().qpos + m.nq);
  std::vector<double> qvel(m.nv, 0.0);
  qvel[12] = 1e11;
  const std::vector<double> act(m.na, 0.0);
  environment->SetState({0, qpos, qvel, act, {}, {}});
  const StepResult result = environment->Step(ConstantAction(0));
  EXPECT_TRUE(result.ended);
  EXPECT_TRUE(result.unstable);
  EXPECT_FALSE(result.overflow);
  EXPECT_EQ(environment->facts().end, EpisodeEnd::kFault);
}

TEST(LocomotionFaults, BadNumbersResetTheOfficialSimulation) {
  auto environment = Profile("myosuite");
  environment->Reset(1);
  const mjModel& m = environment->model();
  const std::vector<double> qpos(environment->data().qpos, environment->data().qpos + m.nq);
  std::vector<double> qvel(m.nv, 0.0);
  qvel[12] = 1e11;
  environment->SetState({1, qpos, qvel, std::vector<double>(m.na, 0.0), {}, {}});
  const StepResult result = environment->Step(ConstantAction(0));
  EXPECT_FALSE(result.unstable);
  EXPECT_FALSE(result.overflow);
  EXPECT_EQ(environment->data().time, 0) << "back to the model's start, as the official code does";
  EXPECT_EQ(environment->data().qpos[1], m.qpos0[1]);
  EXPECT_NE(environment->data().qpos[1], qpos[1]);
}

TEST(LocomotionFaults, AFullContactBufferIsAnOverflow) {
  auto model = LoadModel(LocomotionModel(), CacheDir());
  ASSERT_TRUE(model.ok()) << model.status();
  (*model)->nconmax = 2;
  auto environment = LocomotionEnvironment::Make(ParsedRules(ShippedRules("paper")), *std::move(model));
  ASSERT_TRUE(environment.ok()) << environment.status();
  (*environment)->Reset(1);
  StepResult result;
  for (int t = 0; t < 100 && !result.ended; ++t) {
    result = (*environment)->Step(ConstantAction(-1));
  }
  EXPECT_TRUE(result.ended);
  EXPECT_TRUE(result.overflow);
}

TEST(LocomotionSpeed, AStepAllocatesNothing) {
  auto environment = Profile("paper");
  environment->Reset(6);
  const std::vector<double> action = SineAction(3);
  std::vector<double> observation(LocomotionEnvironment::kObservationSize);
  environment->Step(action);
  const int64_t before = Allocations();
  for (int t = 0; t < 20; ++t) {
    environment->Step(action);
    environment->Observe(observation);
  }
  EXPECT_EQ(Allocations(), before);
}

}  // namespace
}  // namespace myograde::sim
