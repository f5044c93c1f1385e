// Resets, states and steps against recordings of the official environment
// (tests/golden). What a file is checked for follows from its content, so files
// of other seeds and actions can be added.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include <gtest/gtest.h>

#include "tests/sim/dictionary.h"
#include "tests/sim/golden.h"
#include "tests/sim/manipulation/golden_compare.h"

namespace myograde::sim {
namespace {

using nlohmann::json;

std::string Decimal(unsigned __int128 value) {
  std::string digits;
  do {
    digits.insert(digits.begin(), static_cast<char>('0' + static_cast<int>(value % 10)));
  } while ((value /= 10) != 0);
  return digits;
}

// Everything that a state decides without stepping.
void CompareLoadedState(GoldenTable& table, ManipulationEnvironment& env, const json& step,
                        const std::string& where) {
  CompareDictionary(table, env, step.at("obs_extra"), kFormula, "state: ", where);
  CompareReward(table, env, step.at("rwd_dict"), kFormula * 100, "state: ", where);
  CompareShownAndTerms(table, env, step, {kFormula, kFormula}, false, "state: ", where);
  CompareContacts(table, env, step.at("contacts"), kFormula, "state: ", where);
  table.CompareRelative("state: observation (single precision)", OfficialObservation(env),
                        Doubles(step.at("obs")), kSinglePrecision, where);
  table.CompareScaled("state: qacc (relative)",
                      {env.data().qacc, static_cast<size_t>(env.model().nv)},
                      Doubles(step.at("qacc")), kSolverRestart, where);
  table.CompareRelative("state: touch sensor (relative)", {env.data().sensordata, 1},
                        Doubles(step.at("sensordata")), kForceRestart, where);
}

void CompareReset(GoldenTable& table, ManipulationEnvironment& env, const json& reset,
                  const std::string& where) {
  if (reset.contains("rng_after")) {
    EXPECT_EQ(Decimal(env.generator().state()), reset.at("rng_after").at("state")) << where;
  }
  CompareVariation(table, env, reset.at("model"), where);
  table.CompareRelative("reset: observation (single precision)", OfficialObservation(env),
                        Doubles(reset.at("obs_at_reset")), kSinglePrecision, where);
  CompareDictionary(table, env, reset.at("obs_extra"), kFormula, "reset: ", where);
  CompareShownAndTerms(table, env, reset, {kFormula, kFormula}, true, "reset: ", where);
  CompareState(table, env, reset.at("state_after_reset"), kStrict, "reset: ", where);
  CompareContacts(table, env, reset.at("state_after_reset").at("contacts"), kFormula, "reset: ",
                  where);
  table.CompareRelative("reset: max_force (relative)", env.official().max_force,
                        reset.at("state_after_reset").at("max_force"), kForce, where);
}

void CompareFreeStep(GoldenTable& table, ManipulationEnvironment& env, const StepResult& result,
                     const json& step, Bounds bounds, const std::string& prefix,
                     const std::string& where) {
  CompareState(table, env, step, bounds, prefix, where);
  CompareContacts(table, env, step.at("contacts"), bounds.position, prefix, where);
  CompareDictionary(table, env, step.at("obs_extra"), bounds.position, prefix, where);
  CompareReward(table, env, step.at("rwd_dict"), bounds.velocity, prefix, where);
  CompareShownAndTerms(table, env, step, bounds, true, prefix, where);
  const auto official = env.official();
  table.CompareExact(prefix + "goal_touch", static_cast<double>(official.goal_touch),
                     step.at("goal_touch"), where);
  table.CompareRelative(prefix + "max_force (relative)", official.max_force, step.at("max_force"),
                        kForce, where);
  table.CompareExact(prefix + "solved", official.solved,
                     Number(step.at("rwd_dict").at("solved")), where);
  table.CompareExact(prefix + "terminated", result.ended && official.done,
                     Number(step.at("terminated")), where);
}

double LargestDifference(ManipulationEnvironment& env, const json& want) {
  const auto golden = Doubles(want.at("qpos"));
  double largest = 0;
  for (size_t i = 0; i < golden.size(); ++i) {
    largest = std::max(largest, std::abs(env.data().qpos[i] - golden[i]));
  }
  return largest;
}

// Plays a recorded reset's steps freely for as long as they can be compared.
void CheckFreeRun(GoldenTable& table, ManipulationEnvironment& env, const json& file,
                  const json& reset, const std::string& here) {
  const json& steps = reset.at("steps");
  const json* before = &reset.at("state_after_reset");
  Comparable comparable(env);
  int followed = 0;
  for (const json& step : steps) {
    const std::string where = here + " step " + std::to_string(followed);
    const StepResult result = PlayRecorded(env, file, step, followed);
    if (!comparable(env)) break;
    if (comparable.taller() && !FellThrough(env, *std::exchange(before, &step), step)) break;
    const bool strict = followed < kStrictSteps;
    if (!strict && LargestDifference(env, step) > kLong.position) break;
    CompareFreeStep(table, env, result, step, strict ? kStrict : kLong,
                    strict ? "free: " : "long: ", where);
    ++followed;
  }
  std::printf("%s: followed for %d of %zu steps%s\n", here.c_str(), followed, steps.size(),
              comparable.value() ? "" : ", up to a contact that the versions differ in");
}

// Each recorded state on its own, and one step from each to the next, wherever
// no contact is in sight that the versions differ in.
void CheckSingleSteps(GoldenTable& table, ManipulationEnvironment& env, const json& file,
                      const json& steps, const std::string& here) {
  for (size_t t = 0; t < steps.size(); ++t) {
    const std::string where = here + " step " + std::to_string(t);
    if (t > 0) {
      LoadRecordedState(env, steps[t - 1]);
      Comparable comparable(env);
      if (comparable(env)) {
        PlayRecorded(env, file, steps[t], static_cast<int>(t));
        const bool bounced =
            comparable.taller() && !FellThrough(env, steps[t - 1], steps[t]);
        if (comparable(env) && !bounced) {
          CompareState(table, env, steps[t], kSingleStep, "step: ", where);
        }
      }
    }
    LoadRecordedState(env, steps[t]);
    if (Comparable(env)(env)) CompareLoadedState(table, env, steps[t], where);
  }
}

// A file of resets, each followed by steps, of one environment.
void CheckResets(GoldenTable& table, const GoldenFile& file) {
  const auto free = MakeProfile("as-graded");
  const auto single = MakeProfile("as-graded");
  const uint64_t seed = file.json.at("seed");
  int index = 0;
  for (const json& reset : file.json.at("resets")) {
    const std::string here = file.name + " reset " + std::to_string(index++);
    free->Reset(seed);
    single->Reset(seed);
    CompareReset(table, *free, reset, here);
    CheckSingleSteps(table, *single, file.json, reset.at("steps"), here);
    CheckFreeRun(table, *free, file.json, reset, here);
  }
}

// What get_obs_dict of the official environment returns.
const std::vector<std::string> kOfficialKeys = {
    "time", "qp", "qv", "myohand_qpos", "myohand_qvel", "pros_hand_qpos", "pros_hand_qvel",
    "object_qpos", "object_qvel", "start_pos", "goal_pos", "elbow_fle", "max_force",
    "touching_body", "palm_pos", "fin0", "fin1", "fin2", "fin3", "fin4", "Rpalm_pos", "MPL_ori",
    "MPL_ori_err", "obj_pos", "reach_err", "pass_err", "act"};

TEST(ManipulationGolden, ARecordingHasTheWholeDictionary) {
  ASSERT_EQ(kOfficialKeys.size(), 27u);
  std::vector<GoldenFile> files = GoldenFiles();
  std::erase_if(files, [](const GoldenFile& file) { return !IsManipulation(file); });
  ExpectWholeDictionary(files, kOfficialKeys);
}

TEST(ManipulationGolden, ResetsStatesAndStepsAgree) {
  GoldenTable table;
  for (const GoldenFile& file : GoldenFiles()) {
    if (IsManipulation(file) && file.json.contains("resets")) CheckResets(table, file);
  }
  if (table.empty()) GTEST_SKIP() << "no golden file of manipulation resets in the folder";
  table.Print("Manipulation: resets, states and steps");
}

}  // namespace
}  // namespace myograde::sim
