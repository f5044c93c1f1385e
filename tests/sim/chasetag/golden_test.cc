// Model, draws, resets and whole episodes against recordings of the official environment
// (tests/golden/chasetag_*). What is played follows from a file's content, so files of other seeds
// and actions can be added.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "protocol/base/sha256.h"
#include "protocol/tracks/chasetag/track.h"
#include "scoring/chasetag/track.h"
#include "tests/sim/chasetag/helpers.h"
#include "tests/sim/dictionary.h"
#include "tests/sim/hand_golden.h"

namespace myograde::sim {
namespace {

using nlohmann::json;

constexpr double kNoise = 1e-14;  // of a series of size 1: sums come in another order

std::vector<GoldenFile> ChaseFiles() { return GoldenFilesOf("myoChallengeChaseTagP2eval-v0"); }

std::string_view NameOf(OpponentPolicy policy) {
  constexpr std::string_view kNames[] = {"static_stationary", "stationary", "random", "repeller",
                                         "chase_player"};
  return kNames[static_cast<size_t>(policy)];
}

// What the episode's draws changed in the model, and what both versions compile from its files.
void CompareModel(GoldenTable& table, const ChaseTagEnvironment& env, const json& want,
                  const std::string& where) {
  const std::span<const float> heights = env.field().heights();
  EXPECT_EQ(Sha256Hex({reinterpret_cast<const char*>(heights.data()), heights.size_bytes()}),
            want.at("heights_sha256"))
      << where;
  EXPECT_EQ(NameOf(env.opponent().policy()), want.at("policy")) << where;
  const mjModel& model = static_cast<const Environment&>(env).model();
  CompareMuscleModel(table, model, "root", model.nbody, want, where);
  Opponent opponent = env.opponent();
  table.CompareExact("draw: chase_velocity", opponent.chase_speed(), want.at("chase_velocity"),
                     where);
  NumpyGenerator never_drawn_from(0);
  BrownNoise noise = opponent.noise();
  std::vector<double> series[2];
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector2d sample = noise.Sample(never_drawn_from);
    if (i % 100 != 0) continue;
    series[0].push_back(sample[0]);
    series[1].push_back(sample[1]);
  }
  for (size_t i = 0; i < 2; ++i) {
    table.Compare("draw: noise", series[i], Doubles(want.at("noise").at(i)), kNoise, where);
  }
}

// A file's steps with their actions, which its formula gives where they are not recorded.
GoldenFile WithActions(GoldenFile file) {
  const std::string kind = file.json.value("actions_are", "");
  int t = 0;
  for (json& step : file.json.at("resets").at(0).at("steps")) {
    std::vector<double> action(80, -1.0);
    for (int i = 0; kind == "sine" && i < 80; ++i) {
      action[static_cast<size_t>(i)] = std::sin(0.1 * t + i);
    }
    if (!step.contains("action")) step["action"] = action;
    ++t;
  }
  return file;
}

TEST(ChaseTagGolden, ARecordingHasTheWholeDictionary) {
  ExpectWholeDictionary(ChaseFiles(),
                        {"time", "internal_qpos", "internal_qvel", "grf", "torso_angle",
                         "muscle_length", "muscle_velocity", "muscle_force", "act", "opponent_pose",
                         "opponent_vel", "model_root_pos", "model_root_vel", "task", "hfield"});
}

TEST(ChaseTagGolden, ModelDrawsResetsAndEpisodesAgree) {
  GoldenTable table;
  const auto env = MakeChase();
  for (const GoldenFile& recorded : ChaseFiles()) {
    const GoldenFile file = WithActions(recorded);
    const json& reset = file.json.at("resets").at(0);
    const int steps =
        CompareEpisode(table, *env, ChaseTagTrack(), file, [&](const json& model) {
          CompareModel(table, *env, model, file.name);
        });
    const int all = static_cast<int>(reset.at("steps").size());
    std::printf("%s: %s, %d of %d steps\n", file.name.c_str(), env->chases() ? "chase" : "evade",
                steps, all);
    if (steps < all || !reset.at("steps").back().at("terminated").get<bool>()) continue;
    EpisodeFacts facts = env->facts();
    const auto verdict = scoring::Judge(facts, scoring::ChaseTagJudging{});
    const json& metrics = file.json.at("metrics");
    table.Compare("facts: score", verdict.metrics[scoring::ScoreMetric::kScore].value(),
                  Number(metrics.at("score")), kFormula, file.name);
    table.CompareExact("facts: points", FactsOf(*env).solved, Number(metrics.at("points")),
                       file.name);
    table.Compare("facts: time", FactsOf(*env).reported_time, Number(metrics.at("times")), 1e-9,
                  file.name);
  }
  if (table.empty()) GTEST_SKIP() << "no golden file of chase-tag in the folder";
  table.Print("Chase-tag: model, draws, resets and episodes");
}

}  // namespace
}  // namespace myograde::sim
