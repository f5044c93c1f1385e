// The elbow environment's numbers and switches: the "rules" object of a profile
// in configs/tracks/. One implementation reads them all; a profile is nothing
// but a set of values. Angles in rad; a step is a control step of 0.02 s.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "sim/model/episode_rules.h"

namespace myograde::sim {

struct ElbowRules : EpisodeRules {
  enum class EndRule {
    kHeld,  // "held": the target was held for hold_steps steps
    kTime,  // "time": nothing but max_steps
  };

  // The episode's end.
  EndRule end_rule;

  // The target is drawn uniformly from this range. The start is drawn from the
  // joint's own range, which the model has.
  std::array<double, 2> target_range_rad;

  // Held: the error is at most this for so many steps in a row.
  double tolerance_rad;
  int64_t hold_steps;

  double solved_distance_rad;  // the official flag: the error is below it
};

// Strict: every key must be there, none may be unknown, numbers have ranges.
// `where` names the object in errors.
absl::StatusOr<ElbowRules> ParseElbowRules(const nlohmann::json& rules, const std::string& where);

}  // namespace myograde::sim
