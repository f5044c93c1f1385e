// The numbers and switches of chase-tag: the "rules" object of a profile in configs/tracks/. One
// implementation reads them all; a profile is nothing but a set of values.
// Lengths in m, times in s; a step is a control step of 0.01 s.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "sim/model/episode_rules.h"

namespace myograde::sim {

// What the opponent does. The first four are for a person who chases, the last for one who evades.
enum class OpponentPolicy { kAtTheEdge, kStationary, kRandom, kRepelled, kChasing };

struct ChaseTagRules : EpisodeRules {
  // Ends. From time_limit_s on the chaser has lost and the evader won.
  double time_limit_s;
  double tag_distance_m;  // of the pelvis to the opponent, in the plane
  double bounds_m;  // out of bounds: the pelvis is farther than this from the middle, on an axis
  double fall_height_m;  // fallen: the head is less than this above the middle of the feet

  // The start, drawn per episode.
  double start_m;           // x and y lie within plus and minus this
  double start_noise;       // standard deviation of each coordinate, m or rad
  double spawn_distance_m;  // the opponent starts at least so far away

  // The opponent: how often the person chases each of the first four policies, and speeds in m/s
  // (random_speed also in rad/s).
  std::array<double, 4> opponent_shares;
  std::array<double, 2> chase_speed;
  std::array<double, 2> random_speed;
  std::array<double, 2> repelled_speed;

  // Heights in m of hilly and rough patches and of the relief, drawn per patch.
  std::array<double, 2> hills_m;
  std::array<double, 2> roughness_m;
  std::array<double, 2> relief_m;
  double relief_share;  // of episodes with a relief

  // Where the official environment does what nobody would expect, each on or off (README.md tells
  // each).
  bool orientation_with_noise;
  bool first_observation_before_opponent;
  bool start_patch_mirrored;
  bool opponent_speed_unclipped;
};

// Strict: every key must be there, none may be unknown, numbers have ranges.
// `where` names the object in errors.
absl::StatusOr<ChaseTagRules> ParseChaseTagRules(const nlohmann::json& rules,
                                                 const std::string& where);

}  // namespace myograde::sim
