// Model, draws, resets and whole episodes against recordings of the official environment
// (tests/golden/baoding_*). What is played follows from a file's content, so files of other seeds
// and actions can be added.
#include <algorithm>
#include <cstdio>

#include <gtest/gtest.h>

#include "protocol/tracks/baoding/track.h"
#include "tests/sim/baoding/helpers.h"
#include "tests/sim/dictionary.h"
#include "tests/sim/hand_golden.h"

namespace myograde::sim {
namespace {

using nlohmann::json;

std::vector<GoldenFile> BallFiles() { return GoldenFilesOf("myoChallengeBaodingP2-v1"); }

// What the episode's draws changed in the model, and what both versions compile from its files.
void CompareModel(GoldenTable& table, const BaodingEnvironment& env, const json& want,
                  const std::string& where) {
  const mjModel& m = static_cast<const Environment&>(env).model();
  const BallScene& scene = env.scene();
  const TargetPath& path = env.variation().path;
  const auto exact = [&](const char* key, double got, const json& wanted) {
    table.CompareExact(std::string("draw: ") + key, got, Number(wanted), where);
  };
  constexpr int kTaskOf[] = {1, 0, 2};  // of the directions from -1 on
  exact("task", kTaskOf[path.direction + 1], want.at("task"));
  exact("start_angle", path.start_angle, want.at("start_angle"));
  exact("radii", path.x_radius, want.at("radii").at(0));
  exact("radii", path.y_radius, want.at("radii").at(1));
  for (size_t i = 0; i < want.at("goal").size(); ++i) {
    exact("goal", path.TurnAt(static_cast<int64_t>(i), 0.025), want.at("goal").at(i));
  }
  for (size_t i = 0; i < 2; ++i) {
    const int geom = scene.geoms[i];
    exact("ball_mass", m.body_mass[scene.bodies[i]], want.at("ball_mass").at(i));
    exact("ball_rbound", m.geom_rbound[geom], want.at("ball_rbound").at(i));
    for (size_t k = 0; k < 3; ++k) {
      exact("ball_friction", m.geom_friction[3 * geom + k], want.at("ball_friction").at(i).at(k));
      exact("ball_size", m.geom_size[3 * geom + k], want.at("ball_size").at(i).at(k));
    }
    table.Compare("model: target_site_pos", {m.site_pos + 3 * scene.target_sites[i], 3},
                  Doubles(want.at("target_site_pos").at(i)), kFormula, where);
  }
  CompareMuscleModel(table, m, "radius", scene.target_bodies[0], want, where);
}

TEST(BaodingGolden, ARecordingHasTheWholeDictionary) {
  ExpectWholeDictionary(BallFiles(), {"time", "hand_pos", "object1_pos", "object1_velp",
                                      "object2_pos", "object2_velp", "target1_pos", "target2_pos",
                                      "target1_err", "target2_err", "act"});
}

TEST(BaodingGolden, ModelDrawsResetsAndEpisodesAgree) {
  GoldenTable table;
  const auto env = MakeBalls();
  for (const GoldenFile& file : BallFiles()) {
    const int steps = CompareEpisode(table, *env, BaodingTrack(), file, [&](const json& model) {
      CompareModel(table, *env, model, file.name);
    });
    const int all = static_cast<int>(file.json.at("resets").at(0).at("steps").size());
    std::printf("%s: %d of %d steps, radii %.4f and %.4f m\n", file.name.c_str(), steps, all,
                env->variation().sizes[0], env->variation().sizes[1]);
    EXPECT_GE(steps, std::min(all, 20)) << file.name;
    if (steps < all) continue;
    const BaodingFacts facts = FactsOf(*env);
    CompareMetrics(table, file, static_cast<double>(facts.solved_steps) / 200,
                   facts.effort_sum / static_cast<double>(env->facts().steps));
  }
  if (table.empty()) GTEST_SKIP() << "no golden file of Baoding balls in the folder";
  table.Print("Baoding balls: model, draws, resets and episodes");
}

}  // namespace
}  // namespace myograde::sim
