// Model, draws, resets and whole episodes against recordings of the official environment
// (tests/golden/reorientation_*). What is played follows from a file's content, so files of other
// seeds and actions can be added.
#include <algorithm>
#include <cstdio>

#include <gtest/gtest.h>

#include "protocol/tracks/reorientation/track.h"
#include "tests/sim/dictionary.h"
#include "tests/sim/hand_golden.h"
#include "tests/sim/reorientation/helpers.h"

namespace myograde::sim {
namespace {

using nlohmann::json;

std::vector<GoldenFile> DieFiles() { return GoldenFilesOf("myoChallengeDieReorientP2-v0"); }

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
  table.CompareRelative("model: goal_quat", {m.body_quat + 4 * scene.goal_body, 4},
                        Doubles(want.at("goal_quat")), kFormula, where);
  CompareMuscleModel(table, m, "radius", scene.goal_body, want, where);
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
    const int steps = CompareEpisode(table, *env, ReorientationTrack(), file, [&](const json& model) {
      CompareModel(table, *env, model, file.name);
    });
    const int all = static_cast<int>(file.json.at("resets").at(0).at("steps").size());
    std::printf("%s: %d of %d steps, half an edge %+.4f m\n", file.name.c_str(), steps, all,
                env->variation().size_change);
    EXPECT_GE(steps, std::min(all, 20)) << file.name;
    if (steps < all) continue;
    const ReorientationFacts facts = FactsOf(*env);
    CompareMetrics(table, file, facts.solved_steps > 5,
                   facts.effort_sum / static_cast<double>(env->facts().steps));
  }
  if (table.empty()) GTEST_SKIP() << "no golden file of die reorientation in the folder";
  table.Print("Die reorientation: model, draws, resets and episodes");
}

}  // namespace
}  // namespace myograde::sim
