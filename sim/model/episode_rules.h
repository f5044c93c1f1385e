// The rules that all tracks of muscles have, whatever else their profiles say.
#pragma once

#include <cstdint>

#include "protocol/base/config_reader.h"

namespace myograde::sim {

struct EpisodeRules {
  int64_t max_steps;  // control steps, after which an episode ends

  // Where the official environments do what nobody would expect, each on or off (the tracks'
  // README.md tell each).
  bool velocities_times_step;
  bool actions_unclipped;
  bool warnings_reset_simulation;
};

// Reads them from the "rules" object of a profile. Mistakes are the reader's.
inline void ReadEpisodeRules(ConfigReader& reader, EpisodeRules& rules) {
  rules.max_steps = reader.Integer("max_steps", 1, 1'000'000);
  rules.velocities_times_step = reader.Boolean("velocities_times_step");
  rules.actions_unclipped = reader.Boolean("actions_unclipped");
  rules.warnings_reset_simulation = reader.Boolean("warnings_reset_simulation");
}

}  // namespace myograde::sim
