// Model, draws, resets and whole episodes against recordings of the official environment
// (tests/golden/relocation_*). What is played follows from a file's content, so files of other
// seeds and actions can be added.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

#include "protocol/tracks/relocation/track.h"
#include "tests/sim/dictionary.h"
#include "tests/sim/hand_golden.h"
#include "tests/sim/relocation/helpers.h"

namespace myograde::sim {
namespace {

using nlohmann::json;

std::vector<GoldenFile> ObjectFiles() { return GoldenFilesOf("myoChallengeRelocateP2eval-v0"); }

// What the episode's draws changed in the model, and what both versions compile from its files.
void CompareModel(GoldenTable& table, const RelocationEnvironment& env, const json& want,
                  const std::string& where) {
  const mjModel& m = static_cast<const Environment&>(env).model();
  const RelocationScene& scene = env.scene();
  const int geom = scene.first_geom;
  const auto exact = [&](const char* key, const auto* got) {
    const std::vector<double> numbers = Doubles(want.at(key));
    const std::vector<double> mine(got, got + numbers.size());
    table.CompareExact(std::string("draw: ") + key, mine, numbers, where);
  };
  exact("goal_pos", m.body_pos + 3 * scene.goal_body);
  exact("object_pos", m.body_pos + 3 * scene.object_body);
  exact("shape_type", m.geom_type + geom);
  exact("shape_size", m.geom_size + 3 * geom);
  exact("shape_pos", m.geom_pos + 3 * geom);
  exact("shape_rgba", m.geom_rgba + 4 * geom);
  exact("shape_friction", m.geom_friction + 3 * geom);
  exact("shape_rbound", m.geom_rbound + geom);
  table.CompareExact("draw: object_mass", m.body_mass[scene.object_body], want.at("object_mass"),
                     where);
  const auto close = [&](const char* key, const mjtNum* got, size_t size) {
    table.CompareRelative(std::string("model: ") + key, {got, size}, Doubles(want.at(key)),
                          kFormula, where);
  };
  close("goal_quat", m.body_quat + 4 * scene.goal_body, 4);
  close("shape_quat", m.geom_quat + 4 * geom, 4 * RelocationVariation::kShapes);
  CompareMuscleModel(table, m, "clavicle", scene.goal_body, want, where);
}

TEST(RelocationGolden, ARecordingHasTheWholeDictionary) {
  ExpectWholeDictionary(ObjectFiles(), {"time", "hand_qpos", "hand_qpos_corrected", "hand_qvel",
                                        "obj_pos", "goal_pos", "palm_pos", "pos_err", "reach_err",
                                        "obj_rot", "goal_rot", "rot_err", "act"});
}

TEST(RelocationGolden, ModelDrawsResetsAndEpisodesAgree) {
  GoldenTable table;
  const auto env = MakeObject();
  RelocationRules of_the_state = ObjectRules();
  of_the_state.first_observation_of_first_draw = false;
  const auto shown = MakeObject(of_the_state);
  for (const GoldenFile& file : ObjectFiles()) {
    const json& reset = file.json.at("resets").at(0);
    // What a reset returns may be of its first draw; the official dictionary never is.
    shown->Reset(file.json.at("seed"));
    CompareShown(
        table, ShownByName(*shown, RelocationTrack()), reset.at("obs_dict"),
        [](std::string_view) { return kState; }, "reset: ", file.name);
    const int steps = CompareEpisode(
        table, *env, RelocationTrack(), file,
        [&](const json& model) {
          CompareModel(table, *env, model, file.name);
        });
    const int all = static_cast<int>(reset.at("steps").size());
    std::printf("%s: %d draws, %d of %d steps\n", file.name.c_str(), env->draws(), steps, all);
    EXPECT_GE(steps, std::min(all, 30)) << file.name << ": the object has landed long before";
    if (steps < all) continue;
    const RelocationFacts facts = FactsOf(*env);
    CompareMetrics(table, file, facts.solved_steps > 5,
                   facts.effort_sum / static_cast<double>(env->facts().steps));
  }
  if (table.empty()) GTEST_SKIP() << "no golden file of relocation in the folder";
  table.Print("Relocation: model, draws, resets and episodes");
}

}  // namespace
}  // namespace myograde::sim
