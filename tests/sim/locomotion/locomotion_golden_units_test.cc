// The parts of the official environment on their own: leg controller, terrain,
// height map, ends, and whole episodes with their metrics.
#include <cmath>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>
#include <gtest/gtest.h>

#include "protocol/base/sha256.h"
#include "sim/locomotion/height_map.h"
#include "tests/sim/golden.h"
#include "tests/sim/locomotion/fixture.h"

namespace myograde::sim {
namespace {

bool IsLocomotion(const GoldenFile& file) {
  return file.json.value("env", "").find("OslRun") != std::string::npos;
}

LegState StateNamed(const std::string& name) {
  for (int i = 0; i < kLegStates; ++i) {
    if (name == LegStateName(static_cast<LegState>(i))) return static_cast<LegState>(i);
  }
  ADD_FAILURE() << "no leg state is named " << name;
  return LegState::kEarlyStance;
}

// What the recording fed the controller at update k (the file's note).
LegSensors RecordedSensors(int k) {
  return {.load = 400 + 420 * std::sin(0.07 * k + 2),
          .knee_angle = 0.6 + 0.6 * std::sin(0.15 * k),
          .knee_velocity = 1.5 * std::cos(0.15 * k),
          .ankle_angle = 0.3 * std::sin(0.11 * k + 1),
          .ankle_velocity = 0.7 * std::cos(0.11 * k + 1)};
}

TEST(LocomotionGoldenUnits, LegController) {
  GoldenTable table;
  for (const GoldenFile& file : GoldenFiles()) {
    if (!file.json.contains("runs")) continue;
    for (const auto& run : file.json["runs"]) {
      LegController leg;
      leg.set_state(StateNamed(run.at("init")));
      for (int k = 0; k < std::ssize(run.at("records")); ++k) {
        const auto& record = run["records"][k];
        const std::string where = absl::StrCat(file.name, " from ",
                                               run["init"].get<std::string>(), " update ", k);
        const LegTorques torques = leg.Update(RecordedSensors(k));
        EXPECT_EQ(LegStateName(leg.state()), record[0]) << where;
        // The recording's sines and cosines are another library's.
        table.Compare("knee torque (N m)", torques.knee, record[1], 1e-12, where);
        table.Compare("ankle torque (N m)", torques.ankle, record[2], 1e-12, where);
      }
    }
  }
  if (table.empty()) GTEST_SKIP() << "no golden file of the leg controller in this folder";
  table.Print("Leg controller against the official one");
}

TEST(LocomotionGoldenUnits, LegSetsActWhenSelected) {
  GoldenTable table;
  for (const GoldenFile& file : GoldenFiles()) {
    if (!file.json.contains("mode_sequence")) continue;
    // The recording held the leg still here, then uploaded a set 0 whose early
    // stance has a knee of 50 N m/rad.
    const LegSensors sensors = {.load = 0, .knee_angle = 0.5, .knee_velocity = 0.1,
                                .ankle_angle = 0.01};
    LegController leg;
    LegParameterSets sets{};
    sets.present = 1;
    std::copy(DefaultLegSet().begin(), DefaultLegSet().end(), std::begin(sets.set[0]));
    sets.set[0][0].knee_stiffness = 50;
    const LegRules rules = OfficialRules("Random").leg;
    const auto& sequence = file.json["mode_sequence"];
    const auto check = [&](int i) {
      const LegTorques torques = leg.Update(sensors);
      EXPECT_EQ(LegStateName(leg.state()), sequence[i][1]);
      table.Compare("knee torque (N m)", torques.knee, sequence[i][2].at("knee"), 1e-12,
                    sequence[i][0].get<std::string>());
    };
    check(0);
    ASSERT_TRUE(leg.Upload(sets, rules).ok());
    check(1);
    leg.Select(0);
    check(2);
    leg.Select(1);
    check(3);
  }
  if (table.empty()) GTEST_SKIP() << "no golden file of the leg's sets in this folder";
  table.Print("Parameter sets of the leg against the official controller");
}

TEST(LocomotionGoldenUnits, Courses) {
  GoldenTable table;
  for (const GoldenFile& file : GoldenFiles()) {
    if (!file.json.contains("cases") || !file.json.contains("heightmaps")) continue;
    for (const auto& one : file.json["cases"]) {
      const std::string where = absl::StrCat(file.name, " ", one.at("terrain").get<std::string>(),
                                             " ", one.at("seed").get<int>());
      const LocomotionRules rules = OfficialRules("Random", one["terrain"]);
      NumpyGenerator random(one["seed"].get<uint64_t>());
      LegacyNumpyGenerator legacy(one["seed"].get<uint32_t>());
      Terrain terrain(rules.field, rules.course, rules.end.distance_from_y_m);
      terrain.Build(random, legacy);
      const std::string bytes(reinterpret_cast<const char*>(terrain.heights().data()),
                              terrain.heights().size_bytes());
      EXPECT_EQ(Sha256Hex(bytes), one.at("hfield").at("sha256_f32le")) << where;
      for (const auto& sample : one["hfield"].at("samples")) {
        table.CompareExact("course heights", terrain.at(sample[0], sample[1]), sample[2], where);
      }
      const std::string state = one.at("rng_after").at("state");
      unsigned __int128 want = 0;
      for (const char digit : state) want = want * 10 + static_cast<unsigned>(digit - '0');
      EXPECT_TRUE(random.state() == want) << where << ": the generator went another way";
    }
  }
  if (table.empty()) GTEST_SKIP() << "no golden file of courses in this folder";
  table.Print("Courses against the official generator");
}

TEST(LocomotionGoldenUnits, HeightMaps) {
  GoldenTable table;
  for (const GoldenFile& file : GoldenFiles()) {
    if (!file.json.contains("heightmaps")) continue;
    const auto& maps = file.json["heightmaps"];
    const LocomotionRules rules = OfficialRules("Random", maps.at("terrain"));
    NumpyGenerator random(maps.at("seed").get<uint64_t>());
    LegacyNumpyGenerator legacy(maps["seed"].get<uint32_t>());
    Terrain terrain(rules.field, rules.course, rules.end.distance_from_y_m);
    terrain.Build(random, legacy);
    for (const auto& pose : maps.at("poses")) {
      std::vector<double> quaternion = Doubles(pose.at("quat"));
      mju_normalize4(quaternion.data());
      std::vector<double> got(kHeightMapSize * kHeightMapSize);
      const Eigen::Vector2d place(Number(pose.at("x")), Number(pose.at("y")));
      OfficialHeightMap(terrain, {place, quaternion.data()}, got);
      table.CompareExact("height map (m)", got, Doubles(pose.at("heightmap")),
                         absl::StrCat(file.name, " y = ", pose["y"].get<double>()));
    }
  }
  if (table.empty()) GTEST_SKIP() << "no golden file of height maps in this folder";
  table.Print("Height maps against the official ones");
}

TEST(LocomotionGoldenUnits, Ends) {
  GoldenTable table;
  for (const GoldenFile& file : GoldenFiles()) {
    if (!file.json.contains("probes") || !IsLocomotion(file)) continue;
    const LocomotionRules rules = OfficialRules(file.json.at("env"));
    auto environment = MakeEnvironment(rules);
    environment->Reset(file.json.at("seed"));
    const std::vector<double> act(environment->model().na, 0.0);
    for (const auto& probe : file.json["probes"]) {
      const std::string where = absl::StrCat(file.name, " ", probe.at("name").get<std::string>());
      environment->SetState(
          {1.25, Doubles(probe.at("qpos")), Doubles(probe.at("qvel")), act, {}, {}});
      const LocomotionTerms terms = environment->terms();
      const auto& want = probe.at("rwd_dict");
      table.CompareExact("done", terms.done(), want.at("done"), where);
      table.CompareExact("solved", terms.solved, want.at("solved"), where);
      table.CompareExact("reported time (s)", terms.lost ? rules.end.time_limit_s : 1.25,
                         probe.at("obs_time"), where);
      table.Compare("reward", terms.dense(), probe.at("reward"), 1e-12, where);
      // Limit forces are the solver's, which stops at 1e-8 of its cost.
      table.Compare("pain", terms.pain, want.at("pain"), 1e-9, where);
    }
  }
  if (table.empty()) GTEST_SKIP() << "no golden file of ends in this folder";
  table.Print("Ends against the official ones");
}

// One recorded episode of a file, played from the environment's own reset to its end: the
// file's actions, its own, or those of the policy that it names.
void PlayEpisode(LocomotionEnvironment& environment, const nlohmann::json& file, const nlohmann::json& want,
                 const std::string& where, GoldenTable& table) {
  environment.ResetEpisode();
  const auto action = [&](int t) {
    for (const nlohmann::json* list : {&file, &want}) {
      if (const auto recorded = RecordedAction(*list, {}, t)) return WithSetZero(*recorded);
    }
    return want.at("policy") == "sin" ? SineAction(t) : ConstantAction(-1);
  };
  double reward = 0;
  StepResult result;
  for (int t = 0; !result.ended && t < 1000; ++t) {
    result = environment.Step(action(t));
    reward += environment.terms().dense();
  }
  const EpisodeFacts facts = environment.facts();
  const auto& walk = std::get<LocomotionFacts>(facts.track);
  EXPECT_EQ(facts.end, LocomotionEnd::kFell) << where;
  table.CompareExact("steps", static_cast<double>(facts.steps), want.at("steps"), where);
  table.Compare("simulated time (s)", facts.sim_time, want.at("sim_time_last"), 0, where);
  table.CompareExact("reported time (s)", walk.reported_time, want.at("obs_time_last"), where);
  table.Compare("effort, sum", walk.effort_sum, want.at("act_reg_sum"), 1e-12, where);
  // Limit forces after a hundred steps of contacts.
  table.Compare("pain, sum", walk.pain_sum, want.at("pain_sum"), 1e-6, where);
  table.Compare("reward, sum", reward, want.at("reward_sum"), 1e-6, where);
  table.Compare("smallest y (m)", walk.min_y, want.at("min_y"), 1e-9, where);
  const mjData& data = environment.data();
  table.Compare("last qpos", std::span<const double>(data.qpos, environment.model().nq),
                Doubles(want.at("qpos_last")), 1e-9, where);
}

TEST(LocomotionGoldenUnits, WholeEpisodes) {
  GoldenTable table;
  for (const GoldenFile& file : GoldenFiles()) {
    if (!file.json.contains("episodes") || !IsLocomotion(file)) continue;
    auto environment = MakeEnvironment(OfficialRules(file.json["env"]));
    environment->Seed(file.json.at("seed"));
    for (const auto& episode : file.json["episodes"]) {
      PlayEpisode(*environment, file.json, episode,
                  absl::StrCat(file.name, " ", episode.at("policy").get<std::string>()), table);
    }
  }
  if (table.empty()) GTEST_SKIP() << "no golden file of whole episodes in this folder";
  table.Print("Whole locomotion episodes against the official environment");
}

}  // namespace
}  // namespace myograde::sim
