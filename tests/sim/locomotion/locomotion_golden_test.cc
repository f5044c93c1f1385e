// Seeded episodes of the official environment, step by step: draws, the state
// after a reset, then 20 steps, both from synchronised states and free-running.
//
// Tolerances and their reasons. What is drawn or only computed from draws is
// exact. MuJoCo 2.2.2 is not the official 3.1.2: its sums run in another order,
// so states differ in the last bit, and contacts multiply that step by step.
// Over 20 steps from a recorded state positions were seen to stay within 1e-12
// (mostly of the light prosthetic ankle), within 1e-11 over 120; the bounds
// leave room for other seeds. Accelerations are the constraint solver's, which
// stops when a step would improve its cost by less than 1e-8; a single step
// starts it elsewhere than the official run did, because no recording has its
// warm start. Forces of stiff contacts, up to 3e4 N, follow positions with
// their stiffness.
#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>
#include <gtest/gtest.h>

#include "protocol/base/sha256.h"
#include "protocol/tracks/locomotion/track.h"
#include "tests/sim/dictionary.h"
#include "tests/sim/golden.h"
#include "tests/sim/locomotion/fixture.h"

namespace myograde::sim {
namespace {

constexpr double kAfterReset = 1e-14;
constexpr double kQpos = 1e-11;
constexpr double kQvel = 1e-8;     // accelerations times the period
constexpr double kAct = 1e-14;     // first-order filters of the controls
constexpr double kCtrl = 1e-9;     // the leg's stiffness times its angles
constexpr double kForce = 1e-5;    // N
constexpr double kQacc = 1e-7;     // relative to their size; 1.1e-8 was seen in 200,000
constexpr double kSingle = 1e-6;   // relative: the official vector is single precision
constexpr double kPain = 1e-9;

// How far a single step from the official state may be off.
constexpr double kStepQpos = 1e-11;

// Free-running steps with the bounds above, and those with kLonger times them.
constexpr int kFreeSteps = 20;
constexpr int kLongSteps = 120;
constexpr double kLonger = 100;

std::string Text(unsigned __int128 value) {
  std::string digits;
  do {
    digits.insert(digits.begin(), static_cast<char>('0' + static_cast<int>(value % 10)));
    value /= 10;
  } while (value != 0);
  return digits;
}

// A file of whole episodes of the locomotion track.
bool IsEpisodeFile(const GoldenFile& file) {
  return file.json.contains("resets") &&
         file.json.value("env", "").find("OslRun") != std::string::npos;
}

class EpisodeFile {
 public:
  EpisodeFile(const GoldenFile& file, GoldenTable& table)
      : name_(file.name), json_(file.json), table_(table) {
    const nlohmann::json arguments = json_.value("make_kwargs", nlohmann::json::object());
    environment_ = MakeEnvironment(
        OfficialRules(json_.at("env"), arguments.value("terrain", "")));
    if (!arguments.value("normalize_act", true)) {
      environment_->SetConvention(ActionConvention::kDirect);
    }
    environment_->Seed(json_.at("seed"));
  }

  void Check() {
    for (const auto& reset : json_.at("resets")) {
      environment_->ResetEpisode();
      where_ = absl::StrCat(name_, " reset ", reset.value("reset_index", 0));
      CheckDraws(reset);
      if (json_.contains("x0")) Teleport(reset);
      if (reset.contains("obs_at_reset")) CheckObservation(reset, "reset", "obs_at_reset");
      CheckState(reset.at("state_after_reset"), "reset", 1, kAfterReset, kAfterReset);
      const LegState leg_state = environment_->leg().state();
      SetGolden(reset.at("state_after_reset"));
      PlayFree(reset.at("steps"));
      PlaySynchronised(reset, leg_state);
    }
  }

 private:
  mjData& data() { return environment_->data(); }

  void CheckDraws(const nlohmann::json& reset) {
    if (reset.contains("rng_after")) {
      EXPECT_EQ(Text(environment_->random().state()), reset["rng_after"]["state"]) << where_;
    }
    const Terrain& terrain = environment_->terrain();
    if (reset.contains("terrain_code")) {
      table_.CompareExact("course kind", static_cast<double>(terrain.kind()),
                          reset["terrain_code"], where_);
    }
    const auto& field = reset.at("hfield");
    EXPECT_EQ(Sha256Hex({reinterpret_cast<const char*>(terrain.heights().data()),
                         terrain.heights().size() * sizeof(float)}),
              field.at("sha256_f32le"))
        << where_;
    for (const auto& sample : field.at("samples")) {
      table_.CompareExact("course heights", terrain.at(sample[0], sample[1]), sample[2], where_);
    }
  }

  // Takes over a recorded state. The solver's warm start is the acceleration,
  // the official controls have the two motors behind the muscles.
  void SetGolden(const nlohmann::json& state) {
    const std::vector<double> official = Doubles(state.at("ctrl"));
    const LocomotionIndices& at = environment_->indices();
    std::vector<double> ctrl(official.size());
    for (int i = 0; i < kLegMuscles; ++i) ctrl[at.muscle[i]] = official[i];
    ctrl[at.knee_motor] = official[kLegMuscles];
    ctrl[at.ankle_motor] = official[kLegMuscles + 1];
    environment_->SetState({state.at("time"), Doubles(state.at("qpos")),
                            Doubles(state.at("qvel")), Doubles(state.at("act")), ctrl,
                            Doubles(state.at("qacc"))});
  }

  // Files that put the person elsewhere on the course after the reset.
  void Teleport(const nlohmann::json& reset) {
    const mjModel& m = environment_->model();
    const std::vector<double> act(m.na, 0.0);
    std::vector<double> qpos(data().qpos, data().qpos + m.nq);
    const std::vector<double> qvel(data().qvel, data().qvel + m.nv);
    qpos[0] = json_.at("x0");
    qpos[1] = json_.at("y0");
    qpos[2] += reset.at("lift").get<double>();
    const std::vector<double> warm(data().qacc_warmstart, data().qacc_warmstart + m.nv);
    environment_->SetState({0, qpos, qvel, act, {}, warm});
  }

  // `growth` widens the bounds of what contacts amplify.
  void CheckState(const nlohmann::json& want, const std::string& kind, double growth,
                  double qpos = kQpos, double qvel = kQvel) {
    const auto vector = [](const mjtNum* from, int n) { return std::span<const double>(from, n); };
    const mjModel& m = environment_->model();
    const LocomotionIndices& at = environment_->indices();
    const auto row = [&](const char* quantity) { return absl::StrCat(kind, ": ", quantity); };
    table_.Compare(row("time"), data().time, want.at("time"), 0, where_);
    table_.Compare(row("qpos"), vector(data().qpos, m.nq), Doubles(want.at("qpos")),
                   growth * qpos, where_);
    table_.Compare(row("qvel"), vector(data().qvel, m.nv), Doubles(want.at("qvel")),
                   growth * qvel, where_);
    table_.Compare(row("act"), vector(data().act, m.na), Doubles(want.at("act")), kAct, where_);
    // The official order has the two motors behind the muscles.
    std::vector<double> ctrl;
    for (const int muscle : at.muscle) ctrl.push_back(data().ctrl[muscle]);
    ctrl.push_back(data().ctrl[at.knee_motor]);
    ctrl.push_back(data().ctrl[at.ankle_motor]);
    table_.Compare(row("ctrl"), ctrl, Doubles(want.at("ctrl")), growth * kCtrl, where_);
    table_.Compare(row("sensors (N)"), vector(data().sensordata, m.nsensordata),
                   Doubles(want.at("sensordata")), growth * kForce, where_);
    table_.CompareRelative(row("qacc"), vector(data().qacc, m.nv), Doubles(want.at("qacc")),
                           growth * kQacc, where_);
    table_.CompareExact(row("contacts"), data().ncon, want.at("ncon"), where_);
    table_.CompareExact(row("constraints"), data().nefc, want.at("nefc"), where_);
    table_.Compare(row("head, feet (m)"), vector(data().site_xpos + 3 * at.head_site, 3),
                   Doubles(want.at("head_site")), growth * kQpos, where_);
    table_.Compare(row("head, feet (m)"), vector(data().xpos + 3 * at.talus_body, 3),
                   Doubles(want.at("talus_l")), growth * kQpos, where_);
    table_.Compare(row("head, feet (m)"), vector(data().xpos + 3 * at.leg_foot_body, 3),
                   Doubles(want.at("osl_foot")), growth * kQpos, where_);
    EXPECT_EQ(LegStateName(environment_->leg().state()), want.at("osl_state")) << where_;
  }

  void CheckLegSensors(const nlohmann::json& want) {
    const LegSensors got = environment_->SenseLeg();
    const std::vector<double> motion = {got.knee_angle, got.knee_velocity, got.ankle_angle,
                                        got.ankle_velocity};
    const std::vector<double> official = {want.at("knee_angle"), want.at("knee_vel"),
                                          want.at("ankle_angle"), want.at("ankle_vel")};
    table_.CompareExact("single: leg's angles and velocities", motion, official, where_);
    table_.Compare("single: leg's load (N)", got.load, want.at("load"), kForce, where_);
  }

  // The 260 numbers of the official vector and the pieces of the 365.
  void CheckObservation(const nlohmann::json& want, const std::string& kind, const char* key) {
    const auto row = [&](const char* quantity) { return absl::StrCat(kind, ": ", quantity); };
    std::vector<double> official(LocomotionEnvironment::kOfficialObservationSize);
    environment_->ObserveOfficial(official);
    table_.CompareRelative(row("official observation (single)"), official, Doubles(want.at(key)),
                           kSingle, where_);
    std::vector<double> full(LocomotionEnvironment::kObservationSize);
    environment_->Observe(full);
    const auto part = [&](int from, int to) {
      return std::span<const double>(full).subspan(from, to - from);
    };
    // Muscles have no double-precision record; they stand at other places here.
    table_.CompareRelative(row("muscles in both vectors (single)"), part(99, 261),
                           Doubles(want.at(key)).size() == 260
                               ? std::vector<double>(official.begin() + 44, official.begin() + 206)
                               : std::vector<double>(),
                           0, where_);
    const auto& extra = want.at("obs_extra");
    const auto list = [&](const char* name) {
      const auto& value = extra.at(name);
      return value.is_array() ? Doubles(value) : std::vector<double>{value.get<double>()};
    };
    table_.CompareExact(row("obs terrain"), part(1, 2), list("terrain"), where_);
    table_.Compare(row("obs qpos"), part(2, 19), list("internal_qpos"), kQpos, where_);
    table_.Compare(row("obs qvel x dt"), part(19, 36), list("internal_qvel"), kQvel * 0.005,
                   where_);
    table_.Compare(row("obs forces (N)"), part(36, 38), list("grf"), kForce, where_);
    table_.Compare(row("obs forces (N)"), part(38, 41), list("socket_force"), kForce, where_);
    table_.Compare(row("obs pelvis"), part(41, 45), list("torso_angle"), kQpos, where_);
    table_.Compare(row("obs root"), part(261, 263), list("model_root_pos"), kQpos, where_);
    table_.Compare(row("obs root velocity"), part(263, 265), list("model_root_vel"), kQvel,
                   where_);
    table_.CompareExact(row("height map"), part(265, 365), list("hfield"), where_);
  }

  // The whole dictionary by name, and all terms of the reward.
  void CheckShownAndTerms(const nlohmann::json& step, const std::string& kind) {
    const auto tolerance = [](std::string_view key) {
      if (key == "grf" || key == "socket_force" || key == "muscle_force") return kForce;
      return key.ends_with("qvel") || key.ends_with("_vel") || key == "muscle_velocity" ? kQvel
                                                                                        : kQpos;
    };
    const std::string prefix = kind + ": ";
    CompareShown(table_, ShownByName(*environment_, LocomotionTrack()), step.at("obs_extra"),
                 tolerance, prefix, where_);
    CompareRewardTerms(table_, *environment_, LocomotionTrack(), step.at("rwd_dict"),
                       [](std::string_view) { return kQvel; }, prefix, where_);
  }

  void CheckTerms(const nlohmann::json& step, const std::string& kind) {
    const LocomotionTerms terms = environment_->terms();
    const auto& want = step.at("rwd_dict");
    const auto row = [&](const char* quantity) { return absl::StrCat(kind, ": ", quantity); };
    table_.Compare(row("effort"), terms.effort, want.at("act_reg"), 1e-14, where_);
    table_.Compare(row("pain"), terms.pain, want.at("pain"), kPain, where_);
    table_.Compare(row("reward"), terms.dense(), step.at("reward"), kQvel, where_);
    table_.CompareExact(row("solved, done"), terms.solved, Flag(want.at("solved")), where_);
    table_.CompareExact(row("solved, done"), terms.done(), Flag(want.at("done")), where_);
  }
  static double Flag(const nlohmann::json& value) {
    return value.is_boolean() ? value.get<bool>() : value.get<double>();
  }

  std::vector<double> ActionOf(const nlohmann::json& step, int t) const {
    const auto action = RecordedAction(json_, step, t);
    return action ? WithSetZero(*action) : SineAction(t);
  }

  void PlayFree(const nlohmann::json& steps) {
    const std::string reset = where_;
    for (int t = 0; t < std::min(static_cast<int>(steps.size()), kLongSteps); ++t) {
      where_ = absl::StrCat(reset, " step ", t);
      environment_->Step(ActionOf(steps[t], t));
      const bool longer = t >= kFreeSteps;
      const std::string kind = longer ? "free, after 20" : "free";
      CheckState(steps[t], kind, longer ? kLonger : 1);
      if (longer) continue;
      CheckObservation(steps[t], kind, "obs");
      CheckTerms(steps[t], kind);
      CheckShownAndTerms(steps[t], kind);
    }
    where_ = reset;
  }

  void PlaySynchronised(const nlohmann::json& reset, LegState leg_state) {
    const std::string name = where_;
    const nlohmann::json* before = &reset.at("state_after_reset");
    environment_->leg().set_state(leg_state);
    for (int t = 0; t < std::ssize(reset.at("steps")); ++t) {
      const auto& step = reset["steps"][t];
      where_ = absl::StrCat(name, " single step ", t);
      SetGolden(*before);
      if (step.contains("osl_sens_before")) CheckLegSensors(step["osl_sens_before"]);
      environment_->Step(ActionOf(step, t));
      CheckState(step, "single", 1, kStepQpos, kQvel);
      if (step.contains("obs_extra")) CheckShownAndTerms(step, "single");
      before = &step;
    }
    where_ = name;
  }

  std::string name_;
  const nlohmann::json& json_;
  GoldenTable& table_;
  std::unique_ptr<LocomotionEnvironment> environment_;
  std::string where_;
};

TEST(LocomotionGolden, ARecordingHasTheWholeDictionary) {
  // What get_obs_dict of the official environment returns.
  const std::vector<std::string> keys = {
      "time", "terrain", "internal_qpos", "internal_qvel", "grf", "socket_force", "torso_angle",
      "muscle_length", "muscle_velocity", "muscle_force", "act", "model_root_pos",
      "model_root_vel", "hfield"};
  ASSERT_EQ(keys.size(), 14u);
  std::vector<GoldenFile> files = GoldenFiles();
  std::erase_if(files, [](const GoldenFile& file) { return !IsEpisodeFile(file); });
  ExpectWholeDictionary(files, keys);
}

TEST(LocomotionGolden, EpisodesFollowTheOfficialOnes) {
  GoldenTable table;
  for (const GoldenFile& file : GoldenFiles()) {
    if (IsEpisodeFile(file)) EpisodeFile(file, table).Check();
  }
  if (table.empty()) GTEST_SKIP() << "no golden file of a locomotion episode in this folder";
  table.Print("Locomotion against the official environment");
}

}  // namespace
}  // namespace myograde::sim
