// Whole recorded episodes of a strong policy on the official environment,
// replayed from their controls. The tapes are large and stay outside the
// project: the folder is named by MYOGRADE_TAPES.
//
// MuJoCo 2.2.2 and 3.1.2 choose other contact points for the prosthesis'
// convex meshes, against the box as against fingers of the arm and the pillar.
// Up to the first such contact a replay must follow the tape; after it, single
// steps from the tape's states must, wherever no mesh touches; and a solved
// episode must still end solved.
#include <algorithm>

#include <gtest/gtest.h>

#include "tests/sim/golden.h"
#include "tests/sim/manipulation/helpers.h"

namespace myograde::sim {
namespace {

using nlohmann::json;

constexpr double kFollows = 1e-9;  // rad, m

json StateOf(const json& tape, size_t t) {
  json state;
  for (const char* key : {"time", "qpos", "qvel", "act", "ctrl", "qacc_warmstart"}) {
    state[key] = tape.at(key)[t];
  }
  return state;
}

void CompareDraws(GoldenTable& table, ManipulationEnvironment& env, const json& tape,
                  const std::string& where) {
  const Variation& drawn = env.variation();
  table.CompareExact("draw: start", {drawn.start.data(), 3}, Doubles(tape.at("start_pos")), where);
  table.CompareExact("draw: goal", {drawn.goal.data(), 3}, Doubles(tape.at("goal_pos")), where);
  table.CompareExact("draw: mass", drawn.mass, tape.at("obj_mass"), where);
  table.CompareExact("draw: friction", {drawn.friction.data(), 3},
                     Doubles(tape.at("obj_friction")), where);
  table.CompareExact("draw: size", {drawn.half_size.data(), 3}, Doubles(tape.at("obj_size")),
                     where);
}

void CompareQpos(GoldenTable& table, const char* quantity, ManipulationEnvironment& env,
                 const json& tape, size_t t, const std::string& where) {
  table.Compare(quantity, {env.data().qpos, static_cast<size_t>(env.model().nq)},
                Doubles(tape.at("qpos")[t]), kFollows, where);
}

void CheckFreeRun(GoldenTable& table, const GoldenFile& file) {
  const json& tape = file.json;
  const auto env = MakeProfile("myosuite");
  env->SetConvention(ActionConvention::kDirect);
  env->Reset(tape.at("seed").get<uint64_t>());
  CompareDraws(table, *env, tape, file.name);
  bool follows = true;
  size_t followed = 0;
  StepResult result;
  for (size_t t = 0; t < tape.at("ctrl").size() && !result.ended; ++t) {
    const std::string where = file.name + " step " + std::to_string(t);
    result = env->Step(Doubles(tape.at("ctrl")[t]));
    follows = follows && !AnyMeshTouches(*env);
    if (!follows) continue;
    ++followed;
    CompareQpos(table, "free: qpos up to the first mesh contact", *env, tape, t, where);
    const auto official = env->official();
    table.Compare("free: effort", official.reward.act, tape.at("act_metric")[t], kFollows,
                  where);
    table.Compare("free: goal distance", official.reward.goal_dist, tape.at("goal_dist")[t],
                  kFollows, where);
    table.Compare("free: reward", official.reward.dense, tape.at("reward")[t], kFollows, where);
    std::vector<double> touch(env->touch().begin(), env->touch().end());
    table.CompareExact("free: touching", touch, Doubles(tape.at("touching")[t]), where);
  }
  EXPECT_GT(followed, 20u) << file.name << " parts from the tape too early to say anything";
  if (tape.at("solved").back().get<bool>()) {
    EXPECT_TRUE(std::get<ManipulationFacts>(env->facts().track).solved)
        << file.name << " was solved on tape";
  }
}

void CheckSingleSteps(GoldenTable& table, const GoldenFile& file) {
  const json& tape = file.json;
  const auto env = MakeProfile("myosuite");
  env->SetConvention(ActionConvention::kDirect);
  env->Reset(tape.at("seed").get<uint64_t>());
  for (size_t t = 1; t < tape.at("ctrl").size(); ++t) {
    const std::string where = file.name + " step " + std::to_string(t);
    LoadRecordedState(*env, StateOf(tape, t - 1));
    if (AnyMeshTouches(*env)) continue;
    env->Step(Doubles(tape.at("ctrl")[t]));
    if (AnyMeshTouches(*env)) continue;
    CompareQpos(table, "step: qpos where no mesh touches", *env, tape, t, where);
  }
}

TEST(ManipulationTapes, AreFollowed) {
  if (TapesDir().empty()) GTEST_SKIP() << "MYOGRADE_TAPES names no folder of recorded episodes";
  GoldenTable table;
  for (const GoldenFile& file : GoldenFilesIn(TapesDir())) {
    if (!file.json.contains("obj_mass")) continue;
    CheckFreeRun(table, file);
    CheckSingleSteps(table, file);
  }
  if (table.empty()) GTEST_SKIP() << "no tape of the manipulation track in MYOGRADE_TAPES";
  table.Print("Manipulation: recorded episodes of a policy");
}

}  // namespace
}  // namespace myograde::sim
