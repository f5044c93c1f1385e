// Model, draws, resets and whole episodes against recordings of the official environment
// (tests/golden/reorientation_*). What is played follows from a file's content, so files of other
// seeds and actions can be added.
#include <algorithm>
#include <cstdio>

#include <gtest/gtest.h>

#include "protocol/tracks/reorientation/track.h"
#include "tests/sim/dictionary.h"
#include "tests/sim/golden.h"
#include "tests/sim/reorientation/helpers.h"

namespace myograde::sim {
namespace {

using nlohmann::json;

// Draws and what is basic arithmetic on them are compared to the last bit. Where both versions of
// MuJoCo evaluate the same formulas, a sum may come in another order.
constexpr double kFormula = 1e-14;
constexpr double kDerived = 1e-12;  // of the model, from many of them
constexpr double kState = 1e-11;   // m, rad: as long as both versions see the same contacts
constexpr double kSpeeds = 1e-9;   // of the number's size, or absolute below 1
// The recorded vector is rounded to single precision.
constexpr double kSingle = 1.2e-7;

std::vector<GoldenFile> DieFiles() {
  std::vector<GoldenFile> files = GoldenFiles();
  std::erase_if(files, [](const GoldenFile& file) {
    return file.json.value("env", "") != "myoChallengeDieReorientP2-v0";
  });
  return files;
}

std::string Decimal(unsigned __int128 value) {
  std::string digits;
  do {
    digits.insert(digits.begin(), static_cast<char>('0' + static_cast<int>(value % 10)));
  } while ((value /= 10) != 0);
  return digits;
}

// What the episode's draws changed in the model, and what both versions compile from its files.
void CompareModel(GoldenTable& table, const ReorientationEnvironment& env, const json& want,
                  const std::string& where) {
  const mjModel& m = static_cast<const Environment&>(env).model();
  const DieScene& scene = env.scene();
  const auto exact = [&](const char* key, const mjtNum* got) {
    const std::vector<double> numbers = Doubles(want.at(key));
    table.CompareExact(std::string("draw: ") + key, {got, numbers.size()}, numbers, where);
  };
  exact("goal_pos", m.body_pos + 3 * scene.goal_body);
  exact("goal_size", m.geom_size + 3 * scene.goal_geom);
  exact("die_friction", m.geom_friction + 3 * scene.first_geom);
  exact("die_size", m.geom_size + 3 * scene.first_geom);
  exact("die_pos", m.geom_pos + 3 * scene.first_geom);
  exact("die_rbound", m.geom_rbound + scene.first_geom);
  table.CompareExact("draw: die_mass", m.body_mass[scene.die_body], want.at("die_mass"), where);
  const auto close = [&](const char* key, const mjtNum* got, double tolerance = kFormula) {
    const std::vector<double> numbers = Doubles(want.at(key));
    table.CompareRelative(std::string("model: ") + key, {got, numbers.size()}, numbers, tolerance,
                          where);
  };
  // Bodies before the hand (pro_sup turns the radius) stand still, and so does the goal.
  const auto bodies = [&](const char* key, const mjtNum* got, size_t size) {
    const auto first = static_cast<size_t>(mj_name2id(&m, mjOBJ_BODY, "radius"));
    const std::vector<double> all = Doubles(want.at(key));
    const size_t count = (static_cast<size_t>(scene.goal_body) - first) * size;
    table.CompareRelative(std::string("model: ") + key, {got + first * size, count},
                          std::span(all).subspan(first * size, count), kFormula, where);
  };
  close("goal_quat", m.body_quat + 4 * scene.goal_body);
  bodies("body_mass", m.body_mass, 1);
  bodies("body_inertia", m.body_inertia, 3);
  bodies("body_ipos", m.body_ipos, 3);
  close("jnt_range", m.jnt_range);
  close("dof_M0", m.dof_M0, kDerived);
  close("dof_invweight0", m.dof_invweight0, kDerived);
  close("actuator_acc0", m.actuator_acc0, kDerived);
  close("actuator_lengthrange", m.actuator_lengthrange);
  close("tendon_length0", m.tendon_length0);
}

bool SameContacts(const mjData& data, const json& recorded) {
  if (static_cast<size_t>(data.ncon) != recorded.size()) return false;
  for (int i = 0; i < data.ncon; ++i) {
    if (recorded[i].at(0) != data.contact[i].geom1 || recorded[i].at(1) != data.contact[i].geom2) {
      return false;
    }
  }
  return true;
}

// As SameContacts, of which a state was recorded.
bool CompareState(GoldenTable& table, ReorientationEnvironment& env, const json& want,
                  const std::string& prefix, const std::string& where) {
  const mjData& d = env.data();
  if (!SameContacts(d, want.at("contacts"))) return false;
  const auto of = [](const mjtNum* numbers, int count) {
    return std::span<const double>(numbers, static_cast<size_t>(count));
  };
  table.CompareExact(prefix + "time", d.time, want.at("time"), where);
  table.Compare(prefix + "qpos", of(d.qpos, 29), Doubles(want.at("qpos")), kState, where);
  table.CompareRelative(prefix + "qvel", of(d.qvel, 29), Doubles(want.at("qvel")), kSpeeds, where);
  table.Compare(prefix + "act", of(d.act, 39), Doubles(want.at("act")), kFormula, where);
  table.Compare(prefix + "ctrl", of(d.ctrl, 39), Doubles(want.at("ctrl")), kFormula, where);
  table.CompareExact(prefix + "constraints", d.nefc, want.at("nefc"), where);
  return true;
}

void CompareSeen(GoldenTable& table, const ReorientationEnvironment& env, const json& want,
                 const char* vector, const std::string& prefix, const std::string& where) {
  const auto tolerance = [](std::string_view key) { return key == "hand_qvel" ? kSpeeds : kState; };
  CompareShown(table, ShownByName(env, ReorientationTrack()), want.at("obs_extra"), tolerance,
               prefix, where);
  table.CompareRelative(prefix + "observation (single precision)", Observed(env),
                        Doubles(want.at(vector)), kSingle, where);
  if (want.contains("rwd_dict")) {
    CompareRewardTerms(table, env, ReorientationTrack(), want.at("rwd_dict"),
                       [](std::string_view key) { return key == "dense" ? 1e-9 : kState; }, prefix,
                       where);
  }
}

// Plays freely from the reset, up to the first step after which the versions see other contacts.
// Returns how many steps agree.
int ComparePlay(GoldenTable& table, ReorientationEnvironment& env, const json& reset,
                const std::string& here) {
  int t = 0;
  for (const json& step : reset.at("steps")) {
    const std::string where = here + " step " + std::to_string(t);
    const StepResult result = env.Step(Doubles(step.at("action")));
    if (!CompareState(table, env, step, "free: ", where)) return t;
    CompareSeen(table, env, step, "obs", "free: ", where);
    table.CompareExact("free: ended", result.ended,
                       step.at("terminated").get<bool>() || step.at("truncated").get<bool>(), where);
    ++t;
  }
  return t;
}

// The official verdict and effort against those of an episode whose every step agreed.
void CompareMetrics(GoldenTable& table, const ReorientationEnvironment& env, const json& file,
                    const std::string& where) {
  const ReorientationFacts facts = FactsOf(env);
  const json& metrics = file.at("metrics");
  table.CompareExact("facts: score", facts.solved_steps > 5, Number(metrics.at("score")), where);
  table.Compare("facts: effort", facts.effort_sum / static_cast<double>(env.facts().steps),
                Number(metrics.at("effort")), kFormula, where);
}

TEST(ReorientationGolden, ARecordingHasTheWholeDictionary) {
  ExpectWholeDictionary(DieFiles(), {"time", "hand_qpos_noMD5", "hand_qpos", "hand_qvel", "obj_pos",
                                     "goal_pos", "pos_err", "obj_rot", "goal_rot", "rot_err",
                                     "act"});
}

TEST(ReorientationGolden, ModelDrawsResetsAndEpisodesAgree) {
  GoldenTable table;
  const auto env = MakeDie();
  for (const GoldenFile& file : DieFiles()) {
    for (const json& reset : file.json.at("resets")) {
      env->Reset(file.json.at("seed"));
      EXPECT_EQ(Decimal(env->generator().state()), reset.at("rng_after").at("state")) << file.name;
      CompareModel(table, *env, reset.at("model"), file.name);
      const bool same =
          CompareState(table, *env, reset.at("state_after_reset"), "reset: ", file.name);
      CompareSeen(table, *env, reset, "obs_at_reset", "reset: ", file.name);
      const int steps = same ? ComparePlay(table, *env, reset, file.name) : 0;
      const int all = static_cast<int>(reset.at("steps").size());
      std::printf("%s: %d of %d steps, half an edge %+.4f m\n", file.name.c_str(), steps, all,
                  env->variation().size_change);
      // MuJoCo 3.1.2 misses contacts of an enlarged die (sim/reorientation/README.md). Others only
      // differ where a contact is at the edge of its margin, which takes a while.
      if (env->variation().size_change < 0) {
        EXPECT_GE(steps, std::min(all, 10)) << file.name;
      }
      if (steps == all) CompareMetrics(table, *env, file.json, file.name);
    }
  }
  if (table.empty()) GTEST_SKIP() << "no golden file of die reorientation in the folder";
  table.Print("Die reorientation: model, draws, resets and episodes");
}

}  // namespace
}  // namespace myograde::sim
