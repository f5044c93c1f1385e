// Model, resets and whole episodes against recordings of the official environment
// (tests/golden/elbow_*). What is played follows from a file's content, so files of other seeds
// and actions can be added.
#include <cstdio>

#include <gtest/gtest.h>

#include "protocol/tracks/elbow/track.h"
#include "tests/sim/dictionary.h"
#include "tests/sim/elbow/helpers.h"
#include "tests/sim/golden.h"

namespace myograde::sim {
namespace {

using nlohmann::json;

// Draws, and what is basic arithmetic on them, are compared to the last bit, and so are the
// parameters of the model that are read from its files. Where both versions of MuJoCo evaluate
// the same formulas, a sum may come in another order: a few units in the last place.
constexpr double kElbowFormula = 1e-14;
// Steps add this up. Damping and muscles hold the elbow back, so differences do not grow. In 100
// whole episodes of random seeds with all kinds of actions angles and lengths differed by at most
// 6e-15, velocities by 3e-14 and forces by 5e-14 of their size, accelerations by 2e-12; the bounds
// leave room for other seeds. A wrong inertial would be seen in the third digit.
constexpr double kElbowAngle = 1e-13;     // rad, and m for lengths
constexpr double kElbowVelocity = 1e-12;  // of the number's size, or absolute below 1
constexpr double kElbowSolver = 1e-10;    // likewise, of accelerations
// The recorded vector is rounded to single precision.
constexpr double kElbowSingle = 1.2e-7;

bool IsElbow(const GoldenFile& file) {
  return file.json.value("env", "") == "myoElbowPose1D6MRandom-v0";
}

std::vector<GoldenFile> ElbowFiles() {
  std::vector<GoldenFile> files = GoldenFiles();
  std::erase_if(files, [](const GoldenFile& file) { return !IsElbow(file); });
  return files;
}

ActionConvention ConventionOf(const json& file) {
  return file.at("make_kwargs").value("normalize_act", true) ? ActionConvention::kNormalized
                                                             : ActionConvention::kDirect;
}

std::string DecimalOf(unsigned __int128 value) {
  std::string digits;
  do {
    digits.insert(digits.begin(), static_cast<char>('0' + static_cast<int>(value % 10)));
  } while ((value /= 10) != 0);
  return digits;
}

std::span<const double> Moving(const mjtNum* array, int size) {
  constexpr int kFirst = 3;  // r_humerus; the bodies before it stand still
  return {array + kFirst * size, static_cast<size_t>(2 * size)};
}

void CompareModel(GoldenTable& table, const mjModel& m, const json& want,
                  const std::string& where) {
  const auto exact = [&](const char* key, const mjtNum* got, size_t size) {
    table.CompareExact(std::string("model: ") + key, {got, size}, Doubles(want.at(key)), where);
  };
  const auto bodies = [&](const char* key, const mjtNum* got, int size) {
    std::vector<double> numbers = Doubles(want.at(key));
    numbers.erase(numbers.begin(), numbers.end() - 2 * size);
    table.CompareExact(std::string("model: ") + key, Moving(got, size), numbers, where);
  };
  bodies("body_mass", m.body_mass, 1);
  bodies("body_inertia", m.body_inertia, 3);
  bodies("body_ipos", m.body_ipos, 3);
  bodies("body_pos", m.body_pos, 3);
  exact("jnt_range", m.jnt_range, 2);
  exact("dof_damping", m.dof_damping, 1);
  exact("dof_armature", m.dof_armature, 1);
  exact("actuator_lengthrange", m.actuator_lengthrange, 12);
  exact("actuator_ctrlrange", m.actuator_ctrlrange, 12);
  const auto close = [&](const char* key, const mjtNum* got, size_t size) {
    table.CompareRelative(std::string("model: ") + key, {got, size}, Doubles(want.at(key)),
                          kElbowFormula, where);
  };
  close("dof_M0", m.dof_M0, 1);
  close("dof_invweight0", m.dof_invweight0, 1);
  close("actuator_acc0", m.actuator_acc0, 6);
}

std::vector<double> ObservationOf(const ElbowEnvironment& env) {
  std::vector<double> observation(env.observation_size());
  env.Observe(observation);
  return observation;
}

void CompareRecorded(GoldenTable& table, ElbowEnvironment& env, const json& want,
                     const std::string& prefix, const std::string& where) {
  mjData& d = env.data();
  table.CompareExact(prefix + "time", d.time, want.at("time"), where);
  table.Compare(prefix + "qpos", {d.qpos, 1}, Doubles(want.at("qpos")), kElbowAngle, where);
  table.CompareRelative(prefix + "qvel", {d.qvel, 1}, Doubles(want.at("qvel")), kElbowVelocity,
                        where);
  table.Compare(prefix + "act", {d.act, 6}, Doubles(want.at("act")), kElbowFormula, where);
  table.Compare(prefix + "ctrl", {d.ctrl, 6}, Doubles(want.at("ctrl")), kElbowFormula, where);
  table.CompareRelative(prefix + "qacc", {d.qacc, 1}, Doubles(want.at("qacc")), kElbowSolver,
                        where);
  table.CompareRelative(prefix + "muscle force", {d.actuator_force, 6},
                        Doubles(want.at("actuator_force")), kElbowVelocity, where);
  table.Compare(prefix + "muscle length", {d.actuator_length, 6},
                Doubles(want.at("actuator_length")), kElbowAngle, where);
  table.CompareExact(prefix + "contacts", d.ncon, want.at("ncon"), where);
  table.CompareExact(prefix + "constraints", d.nefc, want.at("nefc"), where);
}

void CompareReset(GoldenTable& table, ElbowEnvironment& env, const json& reset,
                  const std::string& where) {
  EXPECT_EQ(DecimalOf(env.generator().state()), reset.at("rng_after").at("state")) << where;
  table.CompareExact("draw: target", env.target(), Doubles(reset.at("target")).at(0), where);
  table.CompareExact("draw: start", env.data().qpos[0],
                     Doubles(reset.at("state_after_reset").at("qpos")).at(0), where);
  table.CompareExact("reset: pose_err", ObservationOf(env).at(2),
                     Doubles(reset.at("obs_extra").at("pose_err")).at(0), where);
  table.CompareRelative("reset: observation (single precision)", ObservationOf(env),
                        Doubles(reset.at("obs_at_reset")), kElbowSingle, where);
  CompareRecorded(table, env, reset.at("state_after_reset"), "reset: ", where);
}

void CompareOfficial(GoldenTable& table, const ElbowEnvironment& env, const json& step,
                     const std::string& where) {
  const ElbowEnvironment::Official official = env.official();
  const json& want = step.at("rwd_dict");
  table.Compare("reward: pose", official.pose, Number(want.at("pose")), kElbowAngle, where);
  table.CompareExact("reward: bonus", official.bonus, Number(want.at("bonus")), where);
  table.CompareExact("reward: penalty", official.penalty, Number(want.at("penalty")), where);
  table.Compare("reward: act_reg", official.act_reg, Number(want.at("act_reg")), kElbowFormula,
                where);
  table.Compare("reward: dense", official.dense, Number(want.at("dense")), kElbowAngle, where);
  table.CompareExact("reward: solved", official.solved, Number(want.at("solved")), where);
  table.CompareExact("reward: done", official.done, Number(want.at("done")), where);
}

void CompareShownAndTerms(GoldenTable& table, const ElbowEnvironment& env, const json& step,
                          const std::string& where) {
  const auto tolerance = [](std::string_view key) {
    return key == "qvel" ? kElbowVelocity : kElbowAngle;
  };
  if (step.contains("obs_extra")) {
    CompareShown(table, ShownByName(env, ElbowTrack()), step.at("obs_extra"), tolerance, "free: ",
                 where);
  }
  if (step.contains("rwd_dict")) {
    CompareRewardTerms(table, env, ElbowTrack(), step.at("rwd_dict"), tolerance, "free: ", where);
  }
}

// The sums and counts that an episode's facts hold against those of the recorded steps.
void CompareFacts(GoldenTable& table, const ElbowEnvironment& env, const json& steps,
                  const std::string& where) {
  double effort = 0;
  double error = 0;
  double solved = 0;
  for (const json& step : steps) {
    effort -= Number(step.at("rwd_dict").at("act_reg"));
    error -= Number(step.at("rwd_dict").at("pose"));
    solved += Number(step.at("rwd_dict").at("solved"));
  }
  const ElbowFacts facts = FactsOf(env);
  table.Compare("facts: effort_sum", facts.effort_sum, effort, kElbowAngle, where);
  table.Compare("facts: error_sum", facts.error_sum, error, kElbowVelocity, where);
  table.CompareExact("facts: solved_steps", static_cast<double>(facts.solved_steps), solved,
                     where);
  table.CompareExact("facts: solved", facts.solved,
                     Number(steps.back().at("rwd_dict").at("solved")), where);
  table.CompareExact("facts: reported_time", facts.reported_time, steps.back().at("time"), where);
}

// Plays a recorded episode freely, from the reset to its last step.
void CheckEpisode(GoldenTable& table, ElbowEnvironment& env, const json& reset,
                  const std::string& here) {
  CompareReset(table, env, reset, here);
  CompareShownAndTerms(table, env, reset, here);
  int t = 0;
  for (const json& step : reset.at("steps")) {
    const std::string where = here + " step " + std::to_string(t++);
    const StepResult result = env.Step(Doubles(step.at("action")));
    CompareRecorded(table, env, step, "free: ", where);
    CompareOfficial(table, env, step, where);
    CompareShownAndTerms(table, env, step, where);
    table.CompareRelative("free: observation (single precision)", ObservationOf(env),
                          Doubles(step.at("obs")), kElbowSingle, where);
    const bool ended = step.at("terminated").get<bool>() || step.at("truncated").get<bool>();
    table.CompareExact("free: ended", result.ended, ended, where);
  }
  CompareFacts(table, env, reset.at("steps"), here);
}

// One step from each recorded state to the next.
void CheckSteps(GoldenTable& table, ElbowEnvironment& env, const json& reset,
                const std::string& here) {
  const json* before = &reset.at("state_after_reset");
  int t = 0;
  for (const json& step : reset.at("steps")) {
    LoadRecorded(env, *before);
    env.Step(Doubles(step.at("action")));
    CompareRecorded(table, env, step, "step: ", here + " step " + std::to_string(t++));
    before = &step;
  }
}

TEST(ElbowGolden, ARecordingHasTheWholeDictionary) {
  ExpectWholeDictionary(ElbowFiles(), {"time", "qpos", "qvel", "act", "pose_err"});
}

TEST(ElbowGolden, ModelResetsAndWholeEpisodesAgree) {
  GoldenTable table;
  for (const GoldenFile& file : ElbowFiles()) {
    const auto env = MakeElbowProfile("myosuite");
    env->SetConvention(ConventionOf(file.json));
    CompareModel(table, env->model(), file.json.at("model"), file.name);
    const double period = ElbowEnvironment::kPhysicsSteps * env->model().opt.timestep;
    table.CompareExact("model: control period", period, file.json.at("dt"), file.name);
    for (const json& reset : file.json.at("resets")) {
      env->Reset(file.json.at("seed"));
      CheckEpisode(table, *env, reset, file.name);
      env->Reset(file.json.at("seed"));
      CheckSteps(table, *env, reset, file.name);
    }
  }
  if (table.empty()) GTEST_SKIP() << "no golden file of the elbow in the folder";
  table.Print("Elbow: model, resets and episodes");
}

}  // namespace
}  // namespace myograde::sim
