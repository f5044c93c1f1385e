// What the golden tests of the hand's tracks share: the parts of a recorded episode against an
// environment that plays it.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "protocol/tracks/track_kind.h"
#include "sim/model/muscle_environment.h"
#include "tests/sim/golden.h"

namespace myograde::sim {

// Draws and what is basic arithmetic on them are compared to the last bit. Where both versions of
// MuJoCo evaluate the same formulas, a sum may come in another order.
inline constexpr double kFormula = 1e-14;
inline constexpr double kState = 1e-11;  // m, rad: as long as both versions see the same contacts
inline constexpr double kGrown = 3e-12;  // of positions: contacts may make it tenfold in a step
inline constexpr double kSpeeds = 1e-9;  // of the number's size, or absolute below 1

// Files of the official environment of that name.
std::vector<GoldenFile> GoldenFilesOf(const std::string& official_name);

std::vector<double> Observed(const Environment& env);
// The terms of the official reward.
std::vector<double> Rewards(const Environment& env, const TrackKind& kind);

// Joints, muscles, and the bodies that move, from `first_body` to before body `end`, as both
// versions compile them. Of the hand the first is the radius, which pro_sup turns.
void CompareMuscleModel(GoldenTable& table, const mjModel& model, const char* first_body, int end,
                        const nlohmann::json& want, const std::string& where);

// Plays a recorded episode freely from its reset, up to the first state in which the versions see
// other contacts, or in which rounding has grown so far that the next may be off. Compares the
// generator, every state and all that a policy sees; `compare_model` is for what the reset drew.
// Returns how many steps agree; -1: nor does the reset.
int CompareEpisode(GoldenTable& table, MuscleEnvironment& env, const TrackKind& kind,
                   const GoldenFile& file,
                   const std::function<void(const nlohmann::json& model)>& compare_model);

// The official score and effort of the episode, given those of one whose every step agreed.
void CompareMetrics(GoldenTable& table, const GoldenFile& file, double score, double effort);

}  // namespace myograde::sim
