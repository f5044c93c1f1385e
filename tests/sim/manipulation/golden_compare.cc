#include "tests/sim/manipulation/golden_compare.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "protocol/tracks/manipulation/track.h"
#include "tests/sim/dictionary.h"

namespace myograde::sim {

using nlohmann::json;

namespace {

constexpr size_t kElbowFlexion = 14;  // its place among the arm's joints
constexpr char kKnownFormula[] = "a_t[i] = sin(0.1*t + i), t=0..N-1";

}  // namespace

std::vector<double> SineAction(int t) {
  std::vector<double> action(kMuscles + kServos);
  for (size_t i = 0; i < action.size(); ++i) {
    action[i] = std::sin(0.1 * t + static_cast<double>(i));
  }
  return action;
}

bool IsManipulation(const GoldenFile& file) {
  return file.json.value("env", "") == "myoChallengeBimanual-v0" ||
         file.name.starts_with("manip");
}

void CompareVariation(GoldenTable& table, ManipulationEnvironment& env, const json& want,
                      const std::string& where) {
  const Variation& got = env.variation();
  const Scene& scene = env.scene();
  table.CompareExact("draw: start", {got.start.data(), 3}, Doubles(want.at("start_pos")), where);
  table.CompareExact("draw: goal", {got.goal.data(), 3}, Doubles(want.at("goal_pos")), where);
  table.CompareExact("draw: mass", env.model().body_mass[scene.object_body],
                     want.at("body_mass_obj"), where);
  table.CompareExact("draw: friction", {got.friction.data(), 3},
                     Doubles(want.at("geom_friction_obj")), where);
  table.CompareExact("draw: size", {got.half_size.data(), 3}, Doubles(want.at("geom_size_obj")),
                     where);
  table.CompareExact("model: inertia", {env.model().body_inertia + 3 * scene.object_body, 3},
                     Doubles(want.at("body_inertia_obj")), where);
  table.CompareExact("model: bounding radius", env.model().geom_rbound[scene.object_box],
                     want.at("geom_rbound_obj"), where);
  table.CompareExact("reset: mocap", {env.data().mocap_pos, 6}, Doubles(want.at("mocap_pos")),
                     where);
  table.Compare("reset: init_obj_z", env.reference().object_height, want.at("init_obj_z"),
                kFormula, where);
  table.Compare("reset: init_palm_z", env.reference().palm_height, want.at("init_palm_z"),
                kFormula, where);
}

void CompareDictionary(GoldenTable& table, ManipulationEnvironment& env, const json& want,
                       double tolerance, const std::string& prefix, const std::string& where) {
  const OfficialView view = env.official().view;
  const auto vector = [&](const char* key, const Eigen::Vector3d& got) {
    if (want.contains(key)) {
      table.Compare(prefix + key, {got.data(), 3}, Doubles(want.at(key)), tolerance, where);
    }
  };
  vector("palm_pos", view.palm);
  for (int i = 0; i < kFingers; ++i) {
    vector(("fin" + std::to_string(i)).c_str(), view.fingers.col(i));
  }
  vector("Rpalm_pos", view.prosthesis_palm);
  vector("MPL_ori", view.prosthesis_orientation);
  vector("MPL_ori_err", view.prosthesis_orientation_error);
  vector("obj_pos", view.object);
  vector("reach_err", view.reach_error);
  vector("pass_err", view.pass_error);
  std::vector<double> touch(env.touch().begin(), env.touch().end());
  table.CompareExact(prefix + "touching_body", touch, Doubles(want.at("touching_body")), where);
}

void CompareShownAndTerms(GoldenTable& table, ManipulationEnvironment& env, const json& record,
                          Bounds bounds, bool history, const std::string& prefix,
                          const std::string& where) {
  auto shown = ShownByName(env, ManipulationTrack());
  // What the official dictionary repeats.
  const auto joined = [&](const std::string& kind) {
    std::vector<double> all;
    for (const char* who : {"myohand_", "pros_hand_", "object_"}) {
      const auto& part = shown.at(who + kind);
      all.insert(all.end(), part.begin(), part.end());
    }
    return all;
  };
  shown["qp"] = joined("qpos");
  shown["qv"] = joined("qvel");
  shown["elbow_fle"] = {shown.at("myohand_qpos").at(kElbowFlexion)};
  const auto tolerance = [&](std::string_view key) {
    if (key == "max_force") return history ? kForce : -1;
    return key == "qv" || key.ends_with("qvel") ? bounds.velocity : bounds.position;
  };
  CompareShown(table, shown, record.at("obs_extra"), tolerance, prefix, where);
  if (!record.contains("rwd_dict")) return;
  const auto term = [&](std::string_view key) {
    if (key == "solved" || key == "done") return history ? 0.0 : -1;
    return std::max(bounds.velocity, kFormula * 100);
  };
  CompareRewardTerms(table, env, ManipulationTrack(), record.at("rwd_dict"), term, prefix, where);
}

void CompareReward(GoldenTable& table, ManipulationEnvironment& env, const json& want,
                   double tolerance, const std::string& prefix, const std::string& where) {
  const OfficialReward reward = env.official().reward;
  const std::pair<const char*, double> terms[] = {
      {"reach_dist", reward.reach_dist}, {"act", reward.act},
      {"fin_open", reward.fin_open},     {"fin_dis", reward.fin_dis},
      {"lift_bonus", reward.lift_bonus}, {"lift_height", reward.lift_height},
      {"pass_err", reward.pass_err},     {"goal_dist", reward.goal_dist},
      {"dense", reward.dense}};
  for (const auto& [key, got] : terms) {
    table.Compare(prefix + "reward " + key, got, Number(want.at(key)), tolerance, where);
  }
}

void CompareContacts(GoldenTable& table, ManipulationEnvironment& env, const json& want,
                     double tolerance, const std::string& prefix, const std::string& where) {
  std::vector<std::tuple<double, double, double>> got;
  std::vector<std::tuple<double, double, double>> golden;
  for (int i = 0; i < env.data().ncon; ++i) {
    const mjContact& c = env.data().contact[i];
    got.emplace_back(std::min(c.geom1, c.geom2), std::max(c.geom1, c.geom2), c.dist);
  }
  for (const json& c : want) {
    const double geom1 = c[0];
    const double geom2 = c[1];
    golden.emplace_back(std::min(geom1, geom2), std::max(geom1, geom2), c[2].get<double>());
  }
  table.CompareExact(prefix + "contacts: number", static_cast<double>(got.size()),
                     static_cast<double>(golden.size()), where);
  if (got.size() != golden.size()) return;
  std::ranges::sort(got);
  std::ranges::sort(golden);
  for (size_t i = 0; i < got.size(); ++i) {
    table.CompareExact(prefix + "contacts: geoms",
                       std::vector{std::get<0>(got[i]), std::get<1>(got[i])},
                       std::vector{std::get<0>(golden[i]), std::get<1>(golden[i])}, where);
    table.Compare(prefix + "contacts: distance", std::get<2>(got[i]), std::get<2>(golden[i]),
                  tolerance, where);
  }
}

void CompareState(GoldenTable& table, ManipulationEnvironment& env, const json& want,
                  Bounds bounds, const std::string& prefix, const std::string& where) {
  const mjModel& m = env.model();
  const mjData& d = env.data();
  table.CompareExact(prefix + "time", d.time, want.at("time"), where);
  table.Compare(prefix + "qpos", {d.qpos, static_cast<size_t>(m.nq)}, Doubles(want.at("qpos")),
                bounds.position, where);
  table.Compare(prefix + "qvel", {d.qvel, static_cast<size_t>(m.nv)}, Doubles(want.at("qvel")),
                bounds.velocity, where);
  table.Compare(prefix + "act", {d.act, static_cast<size_t>(m.na)}, Doubles(want.at("act")),
                kFormula, where);
  table.Compare(prefix + "ctrl", OfficialControls(env), Doubles(want.at("ctrl")), kFormula,
                where);
  table.CompareScaled(prefix + "qacc (relative)", {d.qacc, static_cast<size_t>(m.nv)},
                      Doubles(want.at("qacc")), kForce, where);
  table.CompareRelative(prefix + "touch sensor (relative)", {d.sensordata, 1},
                        Doubles(want.at("sensordata")), kForce, where);
}

bool FellThrough(ManipulationEnvironment& env, const json& before, const json& after) {
  constexpr double kNoise = 1e-4;  // m/s, of a box that turns
  const int vertical = env.scene().object_qvel + 2;
  const auto of = [&](const json& state) { return state.at("qvel").at(vertical).get<double>(); };
  const double seconds = Number(after.at("time")) - Number(before.at("time"));
  const double expected = of(before) + env.model().opt.gravity[2] * seconds;
  return std::abs(of(after) - expected) < kNoise &&
         std::abs(env.data().qvel[vertical] - expected) < kNoise;
}

StepResult PlayRecorded(ManipulationEnvironment& env, const json& file, const json& step, int t) {
  if (const auto action = RecordedAction(file, step, t)) return env.Step(*action);
  if (file.value("action_formula", "") == kKnownFormula) return env.Step(SineAction(t));
  env.SetConvention(ActionConvention::kDirect);
  const StepResult result = env.Step(Doubles(step.at("ctrl")));
  env.SetConvention(ActionConvention::kNormalized);
  return result;
}

}  // namespace myograde::sim
