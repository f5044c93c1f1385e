#include "sim/chasetag/rules.h"

#include <algorithm>
#include <numeric>

#include "protocol/base/config_reader.h"

namespace myograde::sim {

absl::StatusOr<ChaseTagRules> ParseChaseTagRules(const nlohmann::json& json,
                                                 const std::string& where) {
  constexpr NumberRange kHeight = {0, 1};
  constexpr NumberRange kShare = {0, 1};
  ConfigReader reader(json, where);
  ChaseTagRules rules = {};
  ReadEpisodeRules(reader, rules);
  rules.time_limit_s = reader.Number("time_limit_s", {0.01, 3600});
  rules.tag_distance_m = reader.Number("tag_distance_m", {1e-4, 10});
  rules.bounds_m = reader.Number("bounds_m", {1, 10});
  rules.fall_height_m = reader.Number("fall_height_m", {-1, 2});
  rules.start_m = reader.Number("start_m", {0, 5.9});
  rules.start_noise = reader.Number("start_noise", {0, 0.2});
  rules.spawn_distance_m = reader.Number("spawn_distance_m", {0, 5});
  const std::vector<double> shares = reader.Numbers("opponent_shares", 4, kShare);
  std::ranges::copy(shares, rules.opponent_shares.begin());
  if (const double sum = std::accumulate(shares.begin(), shares.end(), 0.0);
      sum < 1 - 1e-9 || sum > 1 + 1e-9) {
    reader.Fail("opponent_shares", "must add up to 1");
  }
  rules.chase_speed = reader.Range("chase_speed", {0, 10});
  rules.random_speed = reader.Range("random_speed", {-10, 10});
  rules.repelled_speed = reader.Range("repelled_speed", {0, 10});
  rules.hills_m = reader.Range("hills_m", kHeight);
  rules.roughness_m = reader.Range("roughness_m", kHeight);
  rules.relief_m = reader.Range("relief_m", kHeight);
  rules.relief_share = reader.Number("relief_share", kShare);
  rules.orientation_with_noise = reader.Boolean("orientation_with_noise");
  rules.first_observation_before_opponent = reader.Boolean("first_observation_before_opponent");
  rules.start_patch_mirrored = reader.Boolean("start_patch_mirrored");
  rules.opponent_speed_unclipped = reader.Boolean("opponent_speed_unclipped");
  if (auto status = reader.Finish(); !status.ok()) return status;
  return rules;
}

}  // namespace myograde::sim
