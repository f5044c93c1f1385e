#include "tests/sim/hand_golden.h"

#include <cmath>
#include <utility>

#include <gtest/gtest.h>

#include "sim/tracks.h"
#include "tests/sim/dictionary.h"

namespace myograde::sim {
namespace {

using nlohmann::json;

constexpr double kDerived = 1e-12;  // of the model, from many formulas
constexpr double kSingle = 1.2e-7;  // the recorded vector is rounded to single precision

std::string Decimal(unsigned __int128 value) {
  std::string digits;
  do {
    digits.insert(digits.begin(), static_cast<char>('0' + static_cast<int>(value % 10)));
  } while ((value /= 10) != 0);
  return digits;
}

// In another order the solver rounds otherwise, which contact may amplify.
bool SameContacts(const mjData& data, const json& recorded) {
  std::vector<std::pair<int, int>> mine, theirs;
  for (int i = 0; i < data.ncon; ++i) {
    mine.emplace_back(data.contact[i].geom1, data.contact[i].geom2);
  }
  for (const json& pair : recorded) theirs.emplace_back(pair.at(0), pair.at(1));
  return mine == theirs;
}

bool IsNear(MuscleEnvironment& env, const json& recorded) {
  const std::vector<double> qpos = Doubles(recorded.at("qpos"));
  for (size_t i = 0; i < qpos.size(); ++i) {
    if (!(std::abs(env.data().qpos[i] - qpos[i]) <= kGrown)) return false;
  }
  return true;
}

// As SameContacts. Not every step has a whole state.
bool CompareState(GoldenTable& table, MuscleEnvironment& env, const json& want,
                  const std::string& prefix, const std::string& where) {
  const mjModel& m = env.model();
  const mjData& d = env.data();
  if (!SameContacts(d, want.at("contacts"))) return false;
  if (!want.contains("qpos")) return true;
  const auto of = [](const mjtNum* numbers, int count) {
    return std::span<const double>(numbers, static_cast<size_t>(count));
  };
  table.CompareExact(prefix + "time", d.time, want.at("time"), where);
  table.Compare(prefix + "qpos", of(d.qpos, m.nq), Doubles(want.at("qpos")), kState, where);
  table.CompareRelative(prefix + "qvel", of(d.qvel, m.nv), Doubles(want.at("qvel")), kSpeeds,
                        where);
  table.Compare(prefix + "act", of(d.act, m.na), Doubles(want.at("act")), kFormula, where);
  table.Compare(prefix + "ctrl", of(d.ctrl, m.nu), Doubles(want.at("ctrl")), kFormula, where);
  table.CompareExact(prefix + "constraints", d.nefc, want.at("nefc"), where);
  return true;
}

void CompareSeen(GoldenTable& table, const Environment& env, const TrackKind& kind,
                 const json& want, const char* vector, const std::string& prefix,
                 const std::string& where) {
  const auto tolerance = [](std::string_view key) {
    const bool fast = key.ends_with("_qvel") || key.ends_with("_velp") || key == "model_root_vel" ||
                      key == "muscle_velocity" || key == "muscle_force" || key == "grf";
    return fast ? kSpeeds : kState;
  };
  if (want.contains("obs_extra")) {
    CompareShown(table, ShownByName(env, kind), want["obs_extra"], tolerance, prefix, where);
  }
  if (want.contains(vector)) {
    table.CompareRelative(prefix + "observation (single precision)", Observed(env),
                          Doubles(want[vector]), kSingle, where);
  }
  if (want.contains("rwd_dict")) {
    CompareRewardTerms(
        table, env, kind, want.at("rwd_dict"),
        [](std::string_view key) { return key == "dense" ? 1e-9 : kState; }, prefix, where);
  }
}

}  // namespace

std::vector<GoldenFile> GoldenFilesOf(const std::string& official_name) {
  std::vector<GoldenFile> files = GoldenFiles();
  std::erase_if(
      files, [&](const GoldenFile& file) { return file.json.value("env", "") != official_name; });
  return files;
}

std::vector<double> Observed(const Environment& env) {
  std::vector<double> seen(static_cast<size_t>(env.observation_size()));
  env.Observe(seen);
  return seen;
}

std::vector<double> Rewards(const Environment& env, const TrackKind& kind) {
  std::vector<double> terms(FindSimulatedTrack(kind).reward_terms.size());
  env.RewardTerms(terms);
  return terms;
}

void CompareMuscleModel(GoldenTable& table, const mjModel& model, const char* first_body, int end,
                        const json& want, const std::string& where) {
  const auto close = [&](const char* key, const mjtNum* got, double tolerance = kFormula) {
    const std::vector<double> numbers = Doubles(want.at(key));
    table.CompareRelative(std::string("model: ") + key, {got, numbers.size()}, numbers, tolerance,
                          where);
  };
  const auto bodies = [&](const char* key, const mjtNum* got, size_t size) {
    const auto first = static_cast<size_t>(mj_name2id(&model, mjOBJ_BODY, first_body));
    const std::vector<double> all = Doubles(want.at(key));
    const size_t count = (static_cast<size_t>(end) - first) * size;
    table.CompareRelative(std::string("model: ") + key, {got + first * size, count},
                          std::span(all).subspan(first * size, count), kFormula, where);
  };
  bodies("body_mass", model.body_mass, 1);
  bodies("body_inertia", model.body_inertia, 3);
  bodies("body_ipos", model.body_ipos, 3);
  close("jnt_range", model.jnt_range);
  close("dof_M0", model.dof_M0, kDerived);
  close("dof_invweight0", model.dof_invweight0, kDerived);
  close("actuator_acc0", model.actuator_acc0, kDerived);
  close("actuator_lengthrange", model.actuator_lengthrange);
  close("tendon_length0", model.tendon_length0);
}

int CompareEpisode(GoldenTable& table, MuscleEnvironment& env, const TrackKind& kind,
                   const GoldenFile& file, const std::function<void(const json&)>& compare_model) {
  const json& reset = file.json.at("resets").at(0);
  env.Reset(file.json.at("seed"));
  EXPECT_EQ(Decimal(env.generator().state()), reset.at("rng_after").at("state")) << file.name;
  compare_model(reset.at("model"));
  CompareSeen(table, env, kind, reset, "obs_at_reset", "reset: ", file.name);
  if (!CompareState(table, env, reset.at("state_after_reset"), "reset: ", file.name)) {
    return -1;
  }
  int t = 0;
  for (const json& step : reset.at("steps")) {
    const std::string where = file.name + " step " + std::to_string(t);
    const StepResult result = env.Step(Doubles(step.at("action")));
    if (step.contains("qpos") && !IsNear(env, step)) return t;
    if (!CompareState(table, env, step, "free: ", where)) return t;
    CompareSeen(table, env, kind, step, "obs", "free: ", where);
    table.CompareExact("free: ended", result.ended,
                       step.at("terminated").get<bool>() || step.at("truncated").get<bool>(),
                       where);
    ++t;
  }
  return t;
}

void CompareMetrics(GoldenTable& table, const GoldenFile& file, double score, double effort) {
  const json& metrics = file.json.at("metrics");
  table.Compare("facts: score", score, Number(metrics.at("score")), kFormula, file.name);
  table.Compare("facts: effort", effort, Number(metrics.at("effort")), kFormula, file.name);
}

}  // namespace myograde::sim
